"""What can be turned, and what a dataset is: pipeline and manifest, read and checked."""
