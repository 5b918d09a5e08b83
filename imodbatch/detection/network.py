"""The network: a Faster R-CNN from torchvision's parts that keeps the whole softmax of each RoI.

Faster R-CNN (Ren et al. 2015) proposes boxes, pools the features inside each, then scores and
refines it. torchvision's own `FasterRCNN` refines one box per class and suppresses per class; with
a class per viewpoint that would be thousands of boxes per RoI and one survivor per bin. Here a RoI
has one refined box and one softmax over K·M·N + 1 exclusive classes (Konno et al. 2020, Sec. 3.2).
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torchvision.models.detection._utils import BoxCoder
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.faster_rcnn import TwoMLPHead
from torchvision.models.detection.rpn import RegionProposalNetwork, RPNHead
from torchvision.models.detection.transform import GeneralizedRCNNTransform
from torchvision.ops import MultiScaleRoIAlign
from torchvision.ops.poolers import initLevelMapper

from imodbatch.detection.backbone import DEEPEST_STRIDE, PyramidBackbone, pooled_level_names
from imodbatch.detection.card import Architecture, DetectorCard
from imodbatch.detection.heads import build_head

BOX_CODE_WEIGHTS = (10.0, 10.0, 5.0, 5.0)  # of dx, dy, dw, dh: Faster R-CNN's usual scaling
CANDIDATES_PER_ROI = 4  # anchors per level that enter the proposal NMS, per RoI wanted
RPN_NMS_IOU = 0.7  # Ren et al. 2015, Sec. 3.3


class ScoredRois(NamedTuple):
    """The RoIs of one image: (R, 4) boxes and (R, K·M·N + 1) log-probabilities."""

    boxes: Tensor
    log_probabilities: Tensor


class MultiViewFasterRCNN(nn.Module):
    """The network of a card, with random weights.

    The parts are attributes, in the order in which an image passes them, for inference here and for
    a training loop elsewhere. Batch normalisation is ordinary `BatchNorm2d`: a training with
    pretrained weights and small batches should keep those layers in eval mode.

    Attributes:
        transform: normalises, resizes and batches images (and the boxes of targets).
        backbone: image to feature pyramid.
        rpn: features to proposals; in training mode also its two losses.
        roi_pool: features and boxes to (R, fpn_channels, roi_size, roi_size).
        trunk: pooled RoIs to (R, head_width).
        head: (R, head_width) to (R, K·M·N + 1) logits, background last.
        siblings: heads of other viewpoint grids, trained along; none in a finished detector.
        box_regressor: (R, head_width) to (R, 4) box deltas, the same for all classes.
        box_coder: deltas to boxes and back.
    """

    def __init__(self, card: DetectorCard) -> None:
        super().__init__()
        architecture = card.architecture
        self.transform = GeneralizedRCNNTransform(
            min_size=min(card.image_size),
            max_size=max(card.image_size),
            image_mean=list(architecture.normalisation_mean),
            image_std=list(architecture.normalisation_std),
            size_divisible=DEEPEST_STRIDE,
        )
        self.backbone = PyramidBackbone(architecture)
        self.rpn = _build_rpn(architecture)
        self.roi_pool = _build_roi_pool(architecture)
        n_pooled = architecture.fpn_channels * architecture.roi_size**2
        self.trunk = TwoMLPHead(n_pooled, architecture.head_width)
        self.head = build_head(card)
        self.siblings = nn.ModuleList()
        self.box_regressor = nn.Linear(architecture.head_width, 4)
        self.box_coder = BoxCoder(BOX_CODE_WEIGHTS)

    def roi_features(
        self,
        levels: dict[str, Tensor],
        rois: list[Tensor],
        image_sizes: list[tuple[int, int]],
    ) -> Tensor:
        """Pool RoIs: the second stage, shared by inference and training.

        Args:
            levels: the feature pyramid of a batch.
            rois: per image (R, 4) boxes in pixels of the resized images.
            image_sizes: per image (height, width) after resizing, before padding.

        Returns:
            (ΣR, head_width), from which `head` and `box_regressor` go on.
        """
        features: Tensor = self.trunk(self.roi_pool(levels, rois, image_sizes))
        return features

    def score_rois(
        self,
        levels: dict[str, Tensor],
        rois: list[Tensor],
        image_sizes: list[tuple[int, int]],
    ) -> tuple[Tensor, Tensor]:
        """Pool RoIs and score them; arguments as of `roi_features`.

        Returns:
            logits (ΣR, K·M·N + 1), background last, and box deltas (ΣR, 4).
        """
        features = self.roi_features(levels, rois, image_sizes)
        return self.head(features), self.box_regressor(features)

    def forward(self, images: list[Tensor]) -> list[ScoredRois]:
        """Detect in a batch of images; eval mode only.

        Args:
            images: (3, H, W) float RGB in the range 0 to 1 each.

        Returns:
            Per image at most `n_rois` RoIs, best proposal first, boxes in continuous pixels of the
            image as given, not yet clipped.
        """
        sizes = [(image.shape[-2], image.shape[-1]) for image in images]
        batch, _ = self.transform(images)
        levels = self.backbone(batch.tensors)
        proposals, _ = self.rpn(batch, levels)
        logits, deltas = self.score_rois(levels, proposals, batch.image_sizes)
        # decode gives (ΣR, 1, 4), but (0, 4) when there is no proposal at all
        boxes = self.box_coder.decode(deltas, proposals).reshape(-1, 4)
        counts = [len(rois) for rois in proposals]
        parts = zip(
            torch.split_with_sizes(boxes, counts),
            torch.split_with_sizes(torch.log_softmax(logits, dim=1), counts),
            batch.image_sizes,
            sizes,
            strict=True,
        )
        return [
            ScoredRois(_rescale(box, resized, given), log_probabilities)
            for box, log_probabilities, resized, given in parts
        ]


def build_detector(card: DetectorCard) -> MultiViewFasterRCNN:
    """Build the network of a card with random weights; nothing is downloaded.

    Args:
        card: names architecture, classes and viewpoint grid.

    Returns:
        The network in training mode, float32, on the CPU. The weights come from torch's global
        random generator: call `torch.manual_seed` before for a reproducible start.
    """
    return MultiViewFasterRCNN(card)


def _build_rpn(architecture: Architecture) -> nn.Module:
    """Build the region proposal network with the sampling rules of Ren et al. 2015, Sec. 3.1.2."""
    ratios = [architecture.anchor_aspect_ratios] * len(architecture.anchor_sizes_px)
    anchors = AnchorGenerator(architecture.anchor_sizes_px, tuple(ratios))
    network: nn.Module = RegionProposalNetwork(
        anchor_generator=anchors,
        head=RPNHead(architecture.fpn_channels, anchors.num_anchors_per_location()[0]),
        fg_iou_thresh=0.7,
        bg_iou_thresh=0.3,
        batch_size_per_image=256,
        positive_fraction=0.5,
        pre_nms_top_n={"training": 2000, "testing": CANDIDATES_PER_ROI * architecture.n_rois},
        post_nms_top_n={"training": 2000, "testing": architecture.n_rois},
        nms_thresh=RPN_NMS_IOU,
    )
    return network


def _build_roi_pool(architecture: Architecture) -> MultiScaleRoIAlign:
    """Build RoIAlign over the pyramid; a RoI's level follows its size (Lin et al. 2017, Eq. 1)."""
    names = pooled_level_names(architecture)
    pool = MultiScaleRoIAlign(names, architecture.roi_size, sampling_ratio=2)
    # Said, not inferred: torchvision guesses the strides from the first image's unpadded size and
    # remembers the guess, which is wrong for small images and for whatever follows them.
    strides = [int(name) for name in names]
    pool.scales = [1.0 / stride for stride in strides]
    pool.map_levels = initLevelMapper(strides[0].bit_length() - 1, strides[-1].bit_length() - 1)
    return pool


def _rescale(boxes: Tensor, resized: tuple[int, int], given: tuple[int, int]) -> Tensor:
    """Take (R, 4) boxes from the resized image's pixels to the given image's; sizes are (H, W)."""
    y_ratio, x_ratio = given[0] / resized[0], given[1] / resized[1]
    return boxes * boxes.new_tensor([x_ratio, y_ratio, x_ratio, y_ratio])
