"""From the feature vector of a RoI to the scores of K·M·N + 1 exclusive classes.

Both heads return log-odds up to a constant per row ("logits"), so a softmax gives the probabilities
and a cross entropy trains them. Columns are in the order that `card` states: C order of [class,
elevation, azimuth], background last.
"""

import torch
from torch import Tensor, nn

from imodbatch.detection.card import DetectorCard


class FlatHead(nn.Module):
    """One linear layer with an output per (class, viewpoint) (Konno et al. 2020, Sec. 3.2).

    Attributes:
        logits: the layer, K·M·N + 1 outputs.
    """

    def __init__(self, n_features: int, n_scores: int) -> None:
        super().__init__()
        self.logits = nn.Linear(n_features, n_scores + 1)

    def forward(self, features: Tensor) -> Tensor:
        """Map (R, n_features) to (R, K·M·N + 1) logits."""
        logits: Tensor = self.logits(features)
        return logits


class FactorisedHead(nn.Module):
    """p(class, viewpoint) = p(class) · p(viewpoint | class), still one exclusive softmax.

    A viewpoint's logit is a term shared by all classes plus a term of the class. The shared term
    learns from all classes what a view from above or from the left looks like; the term of a class
    starts at zero and learns where its front is.

    Attributes:
        class_logits: layer with K + 1 outputs, background last.
        shared_view_logits: layer with M·N outputs.
        class_view_logits: layer with K·M·N outputs, C order of [class, elevation, azimuth].
    """

    def __init__(self, n_features: int, n_classes: int, n_viewpoints: int) -> None:
        super().__init__()
        self.class_logits = nn.Linear(n_features, n_classes + 1)
        self.shared_view_logits = nn.Linear(n_features, n_viewpoints)
        self.class_view_logits = nn.Linear(n_features, n_classes * n_viewpoints)
        nn.init.zeros_(self.class_view_logits.weight)
        nn.init.zeros_(self.class_view_logits.bias)

    def forward(self, features: Tensor) -> Tensor:
        """Map (R, n_features) to (R, K·M·N + 1) log-probabilities."""
        log_class = torch.log_softmax(self.class_logits(features), dim=1)
        shared = self.shared_view_logits(features)[:, None, :]
        own = self.class_view_logits(features).unflatten(1, (-1, shared.shape[2]))
        log_view = torch.log_softmax(shared + own, dim=2)
        log_joint = log_class[:, :-1, None] + log_view
        return torch.cat([log_joint.flatten(1), log_class[:, -1:]], dim=1)


def build_head(card: DetectorCard) -> nn.Module:
    """Make the score head that the card names, with random weights."""
    architecture = card.architecture
    if architecture.head == "flat":
        return FlatHead(architecture.head_width, card.n_scores)
    n_viewpoints = card.n_elevations * card.n_azimuths
    return FactorisedHead(architecture.head_width, card.n_classes, n_viewpoints)
