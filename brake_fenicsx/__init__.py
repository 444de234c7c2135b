"""From a scan of the pad surface to the squealing modes of a disc brake."""

__version__ = "0.2.0"
