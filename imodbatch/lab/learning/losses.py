"""One pass over a batch: the losses of both stages, from the network's own parts.

torchvision's `RegionProposalNetwork.forward` knows no ignored boxes, so its steps are called here
one by one, with the labels corrected in between.
"""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torchvision.models.detection.image_list import ImageList
from torchvision.models.detection.rpn import concat_box_prediction_layers

from imodbatch.detection.network import MultiViewFasterRCNN
from imodbatch.lab.learning.targets import ImageTargets, draw_rois, without_ignored
from imodbatch.lab.learning.terms import ScoreLosses, box_loss, score_losses

Losses = dict[str, Tensor]
LOSS_NAMES = ("proposal_score", "proposal_box", "class", "view", "box")


def detection_losses(
    network: MultiViewFasterRCNN,
    images: Sequence[Tensor],
    targets: Sequence[ImageTargets],
    n_classes: int,
    n_rois: int,
    object_fraction: float,
    is_window: bool = False,
) -> Losses:
    """Compute all losses of a batch of images.

    Args:
        network: in training mode.
        images: (3, H, W) float RGB in the range 0 to 1 each.
        targets: of each, in pixels of the image as given.
        n_classes: K.
        n_rois: RoIs drawn per image.
        object_fraction: largest share of objects among them.
        is_window: images are parts of larger ones and keep their scale.

    Returns:
        One scalar per name of `LOSS_NAMES`.
    """
    given = [(image.shape[-2], image.shape[-1]) for image in images]
    batch = _normalised(network, images) if is_window else network.transform(list(images))[0]
    tensors = batch.tensors.contiguous(memory_format=torch.channels_last)
    batch = ImageList(tensors, batch.image_sizes)
    targets = [
        _resize(target, size, resized)
        for target, size, resized in zip(targets, given, batch.image_sizes, strict=True)
    ]
    levels = network.backbone(batch.tensors)
    proposals, losses = _propose(network, batch, levels, targets)
    drawn = [
        draw_rois(found, target, n_classes, n_rois, object_fraction)
        for found, target in zip(proposals, targets, strict=True)
    ]
    rois = [one.rois for one in drawn]
    features = network.roi_features(levels, rois, batch.image_sizes)
    deltas = network.box_regressor(features)
    class_ids = torch.cat([one.class_ids for one in drawn])
    scores = _all_score_losses(network, features, class_ids, torch.cat([d.views for d in drawn]))
    wanted = torch.cat(network.box_coder.encode([one.boxes for one in drawn], rois))
    return losses | {
        "class": scores.class_loss,
        "view": scores.view_loss,
        "box": box_loss(deltas, wanted, class_ids < n_classes),
    }


def crop_losses(
    network: MultiViewFasterRCNN,
    crops: Tensor,
    rois: Tensor,
    class_ids: Tensor,
    views: Tensor,
) -> Losses:
    """Compute the score losses of object crops, one RoI each: cheap practice for the view head.

    Args:
        network: in training mode.
        crops: (C, 3, S, S) float RGB in the range 0 to 1, S a multiple of 32.
        rois: (C, 4) the object's box in each crop.
        class_ids: (C,) categories.
        views: (C, ΣM·N) viewpoint distributions, the siblings' after the main head's.

    Returns:
        The entries "class" and "view" of `LOSS_NAMES`.
    """
    transform = network.transform
    mean = crops.new_tensor(transform.image_mean)[:, None, None]
    std = crops.new_tensor(transform.image_std)[:, None, None]
    normalised = ((crops - mean) / std).contiguous(memory_format=torch.channels_last)
    levels = network.backbone(normalised)
    size = (crops.shape[-2], crops.shape[-1])
    features = network.roi_features(levels, list(rois[:, None]), [size] * len(crops))
    scores = _all_score_losses(network, features, class_ids, views)
    return {"class": scores.class_loss, "view": scores.view_loss}


def _all_score_losses(
    network: MultiViewFasterRCNN, features: Tensor, class_ids: Tensor, views: Tensor
) -> ScoreLosses:
    """Mean of the heads' losses: of the main one and its siblings."""
    all_logits = [head(features) for head in (network.head, *network.siblings)]
    n_scores = [logits.shape[1] - 1 for logits in all_logits]  # K·M·N
    n_classes = sum(n_scores) // views.shape[1]
    parts = torch.split_with_sizes(views, [n // n_classes for n in n_scores], dim=1)
    losses = [
        score_losses(logits, class_ids, part)
        for logits, part in zip(all_logits, parts, strict=True)
    ]
    return ScoreLosses(
        torch.stack([loss.class_loss for loss in losses]).mean(),
        torch.stack([loss.view_loss for loss in losses]).mean(),
    )


def _normalised(network: MultiViewFasterRCNN, images: Sequence[Tensor]) -> ImageList:
    """Make a batch as the network's transform does, without resizing."""
    transform = network.transform
    sizes = [(image.shape[-2], image.shape[-1]) for image in images]
    tensors = [transform.normalize(image) for image in images]
    return ImageList(transform.batch_images(tensors, transform.size_divisible), sizes)


def _propose(
    network: MultiViewFasterRCNN,
    batch: ImageList,
    levels: dict[str, Tensor],
    targets: Sequence[ImageTargets],
) -> tuple[list[Tensor], Losses]:
    """Run the proposal network: (P, 4) proposals per image and its two losses."""
    rpn: Any = network.rpn
    features = list(levels.values())
    objectness, deltas = rpn.head(features)
    anchors = rpn.anchor_generator(batch, features)
    per_level = [score.shape[1] * score.shape[2] * score.shape[3] for score in objectness]
    objectness, deltas = concat_box_prediction_layers(objectness, deltas)
    boxes = rpn.box_coder.decode(deltas.detach(), anchors).view(len(anchors), -1, 4)
    proposals, _ = rpn.filter_proposals(boxes, objectness, batch.image_sizes, per_level)
    labels, matched = rpn.assign_targets_to_anchors(anchors, [{"boxes": t.boxes} for t in targets])
    labels = [
        without_ignored(label, anchor, target.ignored_boxes)
        for label, anchor, target in zip(labels, anchors, targets, strict=True)
    ]
    wanted = rpn.box_coder.encode(matched, anchors)
    score_loss, delta_loss = rpn.compute_loss(objectness, deltas, labels, wanted)
    return proposals, {"proposal_score": score_loss, "proposal_box": delta_loss}


def _resize(target: ImageTargets, given: tuple[int, int], resized: tuple[int, int]) -> ImageTargets:
    """Take the boxes to the resized image's pixels; sizes are (height, width)."""
    y, x = resized[0] / given[0], resized[1] / given[1]
    scale = target.boxes.new_tensor([x, y, x, y])
    return ImageTargets(
        target.boxes * scale, target.class_ids, target.views, target.ignored_boxes * scale
    )
