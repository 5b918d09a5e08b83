"""Faster R-CNN whose classes are (category, elevation bin, azimuth bin), one softmax per box.

Where to read, in order:

- `card`: what a detector is, and the order of the score columns. No torch.
- `files`: the weights and the card of a checkpoint, found and read. No torch.
- `backbone`, `heads`, `network`: the network, from torchvision's parts.
- `checkpoint`: float16 safetensors in and out.
- `folding`, `inference`: `make_detector` and the `Detector` that a stage calls.

This file imports none of them, so that reading a card does not load torch.
"""
