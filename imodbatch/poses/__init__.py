"""Where each frame was taken from, and how well that is known."""
