"""The network at the start of a training: pretrained weights in, early layers and norms frozen."""

from typing import Any

import torch
import torchvision
from torch import Tensor, nn

from imodbatch.detection.efficientnet_lite import imagenet_weights
from imodbatch.detection.heads import build_head
from imodbatch.detection.network import MultiViewFasterRCNN, build_detector
from imodbatch.lab.learning.recipes import Recipe, StartSection


def start_network(classes: tuple[str, ...], recipe: Recipe) -> MultiViewFasterRCNN:
    """Build the network that a training starts from, with its siblings' heads.

    Args:
        classes: K names.
        recipe: says what is built, where the weights come from and what is frozen.

    Returns:
        The network, channels last, ready for `set_training_mode`.

    Raises:
        ConfigError: pretrained weights are wanted that are not installed.
    """
    torch.manual_seed(recipe.seed)
    card, *others = [variant.card(classes, {}, {}) for variant in recipe.variants()]
    network = build_detector(card)
    network.siblings.extend(build_head(other) for other in others)
    if recipe.start.weights == "imagenet":
        weights = _pretrained(card.architecture.backbone)
        body = network.backbone.body
        fitting = {name: weights[name] for name in body.state_dict() if name in weights}
        body.load_state_dict(fitting)  # strict: every layer of the body must have its weights
    limit = recipe.targets.proposals_per_image
    rpn: Any = network.rpn
    rpn._pre_nms_top_n["training"] = 2 * limit
    rpn._post_nms_top_n["training"] = limit
    freeze(network, recipe.start)
    return network.to(memory_format=torch.channels_last)


def freeze(network: MultiViewFasterRCNN, start: StartSection) -> None:
    """Take the early layers, and the normalisations if wanted, out of the training."""
    layers = list(network.backbone.body.children())
    for layer in layers[: start.frozen_layers]:
        layer.requires_grad_(False)
    if start.freeze_batch_norm:
        for norm in _norms(network):
            norm.requires_grad_(False)


def set_training_mode(network: MultiViewFasterRCNN, start: StartSection) -> None:
    """Switch to training mode, but for the normalisations that keep their statistics."""
    network.train()
    frozen = list(network.backbone.body.children())[: start.frozen_layers]
    for layer in frozen:
        layer.eval()
    if start.freeze_batch_norm:
        for norm in _norms(network):
            norm.eval()


def _norms(network: nn.Module) -> list[nn.Module]:
    return [layer for layer in network.modules() if isinstance(layer, nn.BatchNorm2d)]


def _pretrained(backbone: str) -> dict[str, Tensor]:
    """Read a body's ImageNet weights, under the names of `PyramidBackbone.body`."""
    if backbone == "efficientnet_lite0":
        weights = imagenet_weights()
    else:
        network = getattr(torchvision.models, backbone)(weights="IMAGENET1K_V1")
        weights = network.state_dict()
    return {name.removeprefix("features."): tensor for name, tensor in weights.items()}
