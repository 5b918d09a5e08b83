"""Training a detector: images with boxes and viewpoints → weights that the pipeline runs.

recipes     what can be turned; `light`, `paper`, or a TOML file
samples     COCO folders → an endless, numbered row of images with boxes
loader      batches: colours, windows, object crops
targets     what each region should answer
losses      one pass over a batch
terms       the losses of the second stage
start       the network at the beginning
state       the checkpoint of a training that is not done
loop        `train`: step after step, resumable
detectors   what there is so far, tried out and written
validation  AP and viewpoints of a detector on images
log         losses, events, curves
family      detectors of one training joined in one file
"""
