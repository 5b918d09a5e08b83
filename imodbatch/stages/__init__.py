"""One file per arrow of the pipeline. A stage reads tables and images and writes tables."""
