"""What formats of missions share, and what reads files by them."""

from star_core.lazy_names import lazy_names

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)
