"""The numbers of the simulated detector's noise model; `detector` says what they mean together."""

from dataclasses import dataclass, field

from imodbatch.lab.analytic.habits import ViewErrors


@dataclass(frozen=True)
class DetectorModel:
    """The numbers of the noise model. Sizes are the square root of the visible pixels' number.

    Attributes:
        half_found_px: size at which half of the objects are found.
        found_slope_px: how fast that changes with size.
        most_found: chance to find a large object.
        box_sigma: standard deviation of a box's edges, relative to its size.
        loose_chance: chance of a loose box.
        loose_sigma: the same deviation for it.
        double_chance: chance of a second box.
        double_sigma: its deviation.
        strength: logit of the true class, for large objects.
        strength_size_px: size at which that has reached 63 %.
        resemblance: logit of a class that is fully resembled: as strong as the true one.
        bound_sigma: class noise bound to object and view.
        fresh_sigma: class noise of each frame.
        background: background's logit for objects, `doubtful_background` for doubtful boxes
            (second boxes and clutter), `random_background` for random ones.
        clutter_strength: logit of the class that a clutter spot looks like.
        clutter_chance: how often a visible spot fires.
        concentration: of the azimuth's peak; 12 puts about 45 % of 16 bins' mass on one.
        opposite_peak: height of the peak opposite, relative.
        floor: what every view gets, relative to the peak.
        view_sigma: log-normal noise of single scores.
        elevation_sigma_deg: width of the bell over elevations.
        elevation_error_deg: error of its middle.
        bound_view_chance: chance that a view's error is the one bound to it.
        follow_fraction: share of class pairs that turn alike.
        view_errors: how often azimuths are misjudged.
    """

    half_found_px: float = 10.0
    found_slope_px: float = 2.5
    most_found: float = 0.95
    box_sigma: float = 0.04
    loose_chance: float = 0.06
    loose_sigma: float = 0.25
    double_chance: float = 0.12
    double_sigma: float = 0.15
    strength: float = 3.6
    strength_size_px: float = 16.0
    resemblance: float = 3.6
    bound_sigma: float = 0.7
    fresh_sigma: float = 0.6
    background: float = 0.8
    doubtful_background: float = 1.8
    random_background: float = 3.2
    clutter_strength: float = 1.5
    clutter_chance: float = 0.35
    concentration: float = 12.0
    opposite_peak: float = 0.15
    floor: float = 0.02
    view_sigma: float = 0.5
    elevation_sigma_deg: float = 8.0
    elevation_error_deg: float = 4.0
    bound_view_chance: float = 0.5
    follow_fraction: float = 0.5
    view_errors: ViewErrors = field(default_factory=ViewErrors)
