"""A load from a table is the load that was found."""

from __future__ import annotations

import numpy as np

from alignment.measure import measure_and_show
from alignment.values import MeasureSettings
from alignment.wheel.held_load import HeldLoad
from tests import rendered


def test_the_table_of_a_load_is_within_microns_of_the_load() -> None:
    _, sight = measure_and_show(rendered.loaded_images(), rendered.rig(), MeasureSettings())
    assert sight is not None
    assert sight.loaded is not None
    fit = sight.surface.fit
    held = HeldLoad.of(sight.loaded)
    points = sight.surface.points.points
    found = held.heights(points, fit.centre, fit.tilt_axes)
    places = (points - fit.centre) @ fit.tilt_axes.T
    inside = np.hypot(*places.T) > held.start
    expected = sight.loaded.model.height(places)
    assert np.abs(expected).max() > 0.2
    assert np.abs(found - expected)[inside].max() < 0.003
