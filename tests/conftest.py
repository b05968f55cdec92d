"""Fixtures that several test files use."""

from tests.small_set import family, folder, original

__all__ = ["family", "folder", "original"]
