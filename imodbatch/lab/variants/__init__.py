"""Object models in endless variants, to train detectors for real photographs on."""

from imodbatch.lab.variants.catalogue import RGBD5, make_distractor, make_instance

__all__ = ["RGBD5", "make_distractor", "make_instance"]
