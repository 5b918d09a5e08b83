"""Boxes of many frames: put in their places, and made to agree."""
