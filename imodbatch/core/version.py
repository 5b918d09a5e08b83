"""The version, which every table names."""

__version__ = "0.2.0"
