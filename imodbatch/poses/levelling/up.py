"""An estimated up direction with what is known of its worth."""

from dataclasses import dataclass

from imodbatch.poses.levelling.fitting import Fit


@dataclass(frozen=True)
class Up(Fit):
    """Which way is up in the poses' world.

    Attributes:
        margin: by how much the next best direction explains the scene worse: 0 as well, 1 not at
            all.
        tilt_deg: angle to the cameras' mean up.
    """

    margin: float
    tilt_deg: float

    def figures(self) -> dict[str, float]:
        """Its quality as numbers by name."""
        return {
            "up_uncertainty_deg": self.uncertainty_deg,
            "up_plane_share": self.plane_share,
            "up_margin": self.margin,
        }

    def __str__(self) -> str:
        x, y, z = self.direction
        return (
            f"up ({x:.3f}, {y:.3f}, {z:.3f}) ± {self.uncertainty_deg:.1f}° from {self.n_level} "
            f"level and {self.n_upright} upright surfaces with {100 * self.plane_share:.0f} % of "
            f"the points, {self.tilt_deg:.0f}° from the cameras' mean up, next best "
            f"{100 * self.margin:.0f} % worse"
        )
