"""The only importers of heavy libraries: torch, open3d, pycolmap, faster-coco-eval."""
