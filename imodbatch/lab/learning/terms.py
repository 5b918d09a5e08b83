"""The losses of the second stage: which class, from where, and where exactly.

The K·M·N + 1 scores are exclusive, so a cross entropy on them splits into two (the chain rule):

    −log p(class, view) = −log p(class) − log p(view | class)

With a weight of 1 and one cell per target this is the paper's plain cross entropy. A greater weight
of the view part makes up for its slower progress. The split works for either head, since both give
log-odds of the same exclusive classes.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

BOX_BETA = 1 / 9  # where the box loss turns from squares to absolutes: Faster R-CNN's usual value


class ScoreLosses(NamedTuple):
    """Class part and view part, both per RoI drawn (background included)."""

    class_loss: Tensor
    view_loss: Tensor


def score_losses(logits: Tensor, class_ids: Tensor, views: Tensor) -> ScoreLosses:
    """Cross entropy of the whole softmax, in two parts whose sum it is.

    Args:
        logits: (R, K·M·N + 1), C order of [class, elevation, azimuth], background last.
        class_ids: (R,) category, K for background.
        views: (R, M·N) target distribution over the viewpoints; a row of 0 (background, or an
            unknown viewpoint) has no view part.

    Returns:
        Means over the R RoIs; 0 without RoIs.
    """
    n_rois = max(len(logits), 1)
    log_p = torch.log_softmax(logits, dim=1)
    n_classes = (logits.shape[1] - 1) // views.shape[1]
    joint = log_p[:, :-1].reshape(len(log_p), n_classes, views.shape[1])  # (R, K, M·N)
    log_class = torch.cat([joint.logsumexp(dim=2), log_p[:, -1:]], dim=1)
    class_loss = functional.nll_loss(log_class, class_ids, reduction="sum") / n_rois
    seen = torch.nonzero(views.sum(dim=1) > 0).flatten()
    of_class = class_ids[seen]
    log_view = joint[seen, of_class] - log_class[seen, of_class][:, None]
    return ScoreLosses(class_loss, -(views[seen] * log_view).sum() / n_rois)


def box_loss(deltas: Tensor, wanted: Tensor, is_object: Tensor) -> Tensor:
    """Smooth-L1 loss of the refined boxes, one box per RoI whatever its class.

    Args:
        deltas: (R, 4) of the network.
        wanted: (R, 4).
        is_object: (R,) bool; background has no box to be refined to.

    Returns:
        Sum over the objects per RoI drawn.
    """
    loss = functional.smooth_l1_loss(
        deltas[is_object], wanted[is_object], beta=BOX_BETA, reduction="sum"
    )
    return loss / max(len(deltas), 1)
