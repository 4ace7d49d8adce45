"""The verb ``formation``: forms a shape, holds it, and moves it as a whole."""
