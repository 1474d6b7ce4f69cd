"""What every camera driver must do. A new driver overrides `make` and inherits all tests."""

import numpy as np
import pytest

from alignment.errors import CameraConnectionError, CameraError, CameraTimeoutError
from sensors.camera import CameraSettings
from tests.sensors.samples import StillClock


class CameraContract:
    """Override `make`, and the constants where the device is another."""

    NAME = "front_left/head_1/left"
    SETTINGS = CameraSettings(exposure_ms=2.0)
    EXPOSURE_MS = 2.0
    SHAPE = (30, 40)
    DEPTHS = (np.uint8, np.uint16)
    TIMEOUT_S = 0.5
    """Bound of the waiting for a frame that was triggered."""
    DEVICE_CLOCK = True
    """Whether the device has a clock; one without says 0 each time, and never that of this computer."""

    def make(self, clock: StillClock, tmp_path):
        """Return a camera that is not connected yet; a real device leaves the clock alone."""
        raise NotImplementedError

    @pytest.fixture
    def clock(self):
        return StillClock()

    @pytest.fixture
    def camera(self, clock, tmp_path):
        camera = self.make(clock, tmp_path)
        yield camera
        camera.close()

    @pytest.fixture
    def armed(self, camera):
        camera.connect()
        camera.arm(self.SETTINGS)
        return camera

    def test_has_its_name(self, camera):
        assert camera.name == self.NAME

    def test_the_first_trigger_after_arming_counts_one(self, armed):
        assert armed.trigger() == 1

    def test_a_frame_says_what_it_is(self, armed):
        counter = armed.trigger()
        frame = armed.fetch(self.TIMEOUT_S)
        assert frame.camera == self.NAME
        assert frame.trigger_counter == counter
        assert frame.image.shape == self.SHAPE
        assert frame.image.dtype in self.DEPTHS
        assert frame.exposure_ms == pytest.approx(self.EXPOSURE_MS)
        assert np.isfinite([frame.device_time_s, frame.host_time_s]).all()

    def test_frames_come_in_the_order_of_their_triggers(self, armed):
        counters, stamps = [], []
        for expected in (1, 2, 3):
            assert armed.trigger() == expected
            frame = armed.fetch(self.TIMEOUT_S)
            counters.append(frame.trigger_counter)
            stamps.append(frame.host_time_s)
        assert counters == [1, 2, 3]
        assert stamps == sorted(stamps)

    def test_the_device_s_clock_goes_on_and_is_no_older_than_the_trigger(self, armed, clock):
        stamps = []
        for _ in range(3):
            armed.trigger()
            stamps.append(armed.fetch(self.TIMEOUT_S).device_time_s)
            clock.sleep(1.0)
        assert stamps == (sorted(set(stamps)) if self.DEVICE_CLOCK else [0.0] * 3)

    def test_the_clock_goes_on_over_arming(self, armed, clock):
        armed.trigger()
        before = armed.fetch(self.TIMEOUT_S).device_time_s
        clock.sleep(1.0)
        armed.arm(self.SETTINGS)
        armed.trigger()
        after = armed.fetch(self.TIMEOUT_S).device_time_s
        assert after > before or (after, before, self.DEVICE_CLOCK) == (0.0, 0.0, False)

    def test_an_image_is_not_written_over_by_the_next_one(self, armed):
        armed.trigger()
        first = armed.fetch(self.TIMEOUT_S).image
        kept = first.copy()
        armed.trigger()
        second = armed.fetch(self.TIMEOUT_S).image
        assert (first == kept).all()
        assert not np.shares_memory(first, second)
        assert not (first == second).all()

    def test_arming_again_starts_the_count_again_and_forgets_frames(self, armed):
        armed.trigger()
        armed.trigger()
        armed.arm(self.SETTINGS)
        with pytest.raises(CameraTimeoutError):
            armed.fetch(0.0)
        assert armed.trigger() == 1
        assert armed.fetch(self.TIMEOUT_S).trigger_counter == 1

    def test_without_a_trigger_fetch_ends_within_its_bound(self, armed, clock):
        before = clock.now
        with pytest.raises(CameraTimeoutError, match=self.NAME):
            armed.fetch(0.05)
        assert clock.now - before <= 0.05 + 1e-9

    def test_a_negative_timeout_does_not_wait(self, armed, clock):
        with pytest.raises(CameraTimeoutError):
            armed.fetch(-1.0)
        assert clock.slept == []

    def test_exposures_follow_one_another_before_a_frame_is_fetched(self, armed):
        """A wheel that turns is exposed again and again; frames are fetched while the next are exposed."""
        assert [armed.trigger() for _ in range(3)] == [1, 2, 3]
        frames = [armed.fetch(self.TIMEOUT_S) for _ in range(3)]
        assert [frame.trigger_counter for frame in frames] == [1, 2, 3]

    def test_each_frame_is_given_once(self, armed):
        armed.trigger()
        armed.fetch(self.TIMEOUT_S)
        with pytest.raises(CameraTimeoutError):
            armed.fetch(0.0)

    def test_trigger_before_arm_is_refused(self, camera):
        camera.connect()
        with pytest.raises(CameraError, match=self.NAME):
            camera.trigger()

    @pytest.mark.parametrize("act", ["arm", "trigger", "fetch"])
    def test_nothing_works_before_connect(self, camera, act):
        arguments = {"arm": (self.SETTINGS,), "trigger": (), "fetch": (0.0,)}[act]
        with pytest.raises(CameraConnectionError, match=self.NAME):
            getattr(camera, act)(*arguments)

    def test_connect_twice_changes_nothing(self, armed):
        armed.trigger()
        armed.connect()
        assert armed.fetch(self.TIMEOUT_S).trigger_counter == 1

    def test_close_twice_and_before_connect_is_harmless(self, camera):
        camera.close()
        camera.connect()
        camera.close()
        camera.close()

    def test_after_close_it_can_be_connected_again_but_must_be_armed_again(self, armed):
        armed.trigger()
        armed.close()
        with pytest.raises(CameraConnectionError):
            armed.trigger()
        armed.connect()
        with pytest.raises(CameraError):
            armed.trigger()
        armed.arm(self.SETTINGS)
        with pytest.raises(CameraTimeoutError):
            armed.fetch(0.0)
        assert armed.trigger() == 1
        assert armed.fetch(self.TIMEOUT_S).trigger_counter == 1
