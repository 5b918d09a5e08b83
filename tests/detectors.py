"""A small network's shape, and checkpoints read in one go: ``from detectors import ...``."""

from pathlib import Path

from imodbatch.detection.card import Architecture, DetectorCard
from imodbatch.detection.checkpoint import make_network
from imodbatch.detection.files import read_checkpoint
from imodbatch.detection.inference import Detector, make_detector
from imodbatch.detection.network import MultiViewFasterRCNN

LIGHT = Architecture(
    backbone="mobilenet_v2",
    fpn_channels=96,
    fpn_strides=(8, 16, 32),
    anchor_sizes_px=((24, 40), (64, 104), (160, 256)),
    anchor_aspect_ratios=(0.5, 1.0, 2.0),
    head_width=384,
    roi_size=7,
    n_rois=96,
    head="factorised",
    normalisation_mean=(0.485, 0.456, 0.406),
    normalisation_std=(0.229, 0.224, 0.225),
)


def load_network(path: Path) -> tuple[MultiViewFasterRCNN, DetectorCard]:
    return make_network(read_checkpoint(path))


def load_detector(path: Path, device: str = "cpu") -> Detector:
    return make_detector(read_checkpoint(path), device)
