"""Raw folders → frames, poses, annotations, detections. One file per layout or format."""
