"""The figures of the jitters table from APs that are given: mean, spread and draws, on paper."""

import math
from dataclasses import dataclass, field

import pytest
from hand_tables import detection, frame, observation, pose, table

from imodbatch.scoring import jitter
from imodbatch.scoring.rescoring import Evidence
from imodbatch.settings.config import JitterConfig, Pipeline


def pipeline():
    return Pipeline(jitter=JitterConfig(shifts_m=(0.01,), repeats=3))


@dataclass(frozen=True)
class Told(Evidence):
    """One box whose AP is told, draw by draw."""

    aps: list = field(default_factory=list)

    def mean_average_precisions(self, meeting):
        assert meeting.rows.tolist() == [0]
        return {"imod": self.aps.pop(0)}


def test_mean_and_spread_over_the_draws():
    """Undisturbed there is one draw; of n draws the squares are divided by n − 1.

    .2 .4 .9: mean .5, squares .09 + .01 + .16 over 2. Of .2 and .6 the third is unknown: mean .4,
    squares .04 + .04 over 1.
    """
    evidence = Told(
        table("frames", [frame("s", 0)]),
        table("annotations", []),
        table("detections", [detection("s", 0, 0, (0, 0, 1, 1), (1.0,))]),
        table("observations", [observation("s", 0, 0, (1.0, 0.0, 0.0))]),
        1,
        pipeline(),
        [0.875, 0.2, 0.4, 0.9, None, 0.2, None, 0.6],
    )
    result = jitter.run(evidence, table("poses", [pose("s", 0, (0.0, 0.0, 1.0))]))
    found = {
        (r["kind"], r["translation_mm"]): (r["value"], r["spread"], r["n_repeats"])
        for r in result.tables["jitters"].to_pylist()
    }
    assert found == {
        ("jitter", 0): (0.875, None, 1),
        ("jitter", 10): (pytest.approx(0.5), pytest.approx(math.sqrt(0.13)), 3),
        ("drift", 0): (None, None, 1),
        ("drift", 10): (pytest.approx(0.4), pytest.approx(math.sqrt(0.08)), 3),
    }
