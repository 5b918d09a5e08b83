"""Means over classes: a mean, not a median, over those that have the figure."""

import numpy as np
import pytest

from imodbatch.core.scoring import mean_over_classes


def test_a_mean_over_the_classes_that_have_a_value():
    """0, 1/4 and 1: 5/12, where the middle one is 1/4."""
    assert mean_over_classes(np.array([0.0, np.nan, 0.25, 1.0])) == pytest.approx(5 / 12)


def test_no_value_has_no_mean():
    assert np.isnan(mean_over_classes(np.array([np.nan, np.nan])))
