"""Boxes of many frames: put in their places (`lift`), and made to agree (`fuse`, `evidence`)."""
