"""Lets the watch see every finished cycle; another observer watches as before."""

from __future__ import annotations

from station.cycle import CycleReport, Observer, StationState, WheelResult
from station.health.figures import Figures, figures_of
from station.health.watch import CameraWatch, Taken


class WatchingObserver(Observer):
    """Offers what a cycle says of the cameras, without its images.

    Parameters
    ----------
    observer
        Watches as before.
    watch
        Takes the figures.
    """

    def __init__(self, observer: Observer, watch: CameraWatch) -> None:
        self._observer, self._watch = observer, watch

    def entered(self, state: StationState) -> None:
        """Pass on."""
        self._observer.entered(state)

    def wheel_done(self, result: WheelResult) -> None:
        """Pass on."""
        self._observer.wheel_done(result)

    def cycle_done(self, report: CycleReport) -> None:
        """Pass on, and offer the figures of all wheels."""
        results = [wheel.result for wheel in report.evaluation.wheels]
        figures: Figures = {}
        for result in results:
            figures |= figures_of(result.shot, result.measurement)
            for camera, counted in self._watch.counted(result.wheel).items():
                figures.setdefault(camera, {}).update(counted)
        retaken = tuple(result.retaken for result in results if result.retaken is not None)
        self._watch.offer(Taken(report.record.received_utc, figures, retaken, report.record.uuid))
        self._observer.cycle_done(report)
