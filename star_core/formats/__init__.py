"""Names for plugins that read mission files, and functions that read a file by its format."""

from star_core.lazy_names import lazy_names

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)
