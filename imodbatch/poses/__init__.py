"""Where each frame was taken from, and how well that is known.

- `association`: poses that come with a dataset, given to frames; `levelling`: which way is up.
- `slam`, `sfm`: poses from images; `rgbd`: the kit that they, `quality` and the doctor share.
- `quality`: how good poses are; changes none.
"""
