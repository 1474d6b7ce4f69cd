"""A camera behind `sensors.drivers.genicam.device.Device` as makers have them, and what goes wrong."""

import threading
from collections import deque

import numpy as np

from sensors.drivers.driver import SeenCamera
from sensors.drivers.genicam.camera import GenICamCamera
from sensors.drivers.genicam.device import Buffer
from sensors.drivers.genicam.options import GenICamOptions

HEIGHT, WIDTH = 6, 8
NAME = "front_left/head_1/left"


class VendorError(Exception):
    """What a maker's library raises."""


class StubDevice:
    """A camera of features in a table, whose line, or whose network, others may pull (`expose`)."""

    def __init__(self, serial="4711", first_frame_id=1, model="stub", user_name="", **features):
        self.first_frame_id = first_frame_id
        self.seen = SeenCamera(serial, model, "10.0.0.1", user_name)
        self.features = {
            "UserSetSelector": "Default",
            "AcquisitionMode": "SingleFrame",
            "ExposureAuto": "Continuous",
            "GainAuto": "Off",
            "TriggerSelector": "FrameStart",
            "TriggerMode": "Off",
            "TriggerSource": "Line1",
            "TriggerActivation": "FallingEdge",
            "PixelFormat": "Mono16",
            "Width": 4,
            "Height": 4,
            "OffsetX": 3,
            "OffsetY": 2,
            "ExposureTime": 20000.0,
            "Gain": 3.0,
            "GevSCPSPacketSize": 1500,
            "DeviceTemperature": 41.5,
            "LineSelector": "Line1",
            "LineMode": "Input",
            "LineSource": "Off",
            "ActionSelector": 1,
            "ActionGroupKey": 0,
            "ActionGroupMask": 0,
            "PtpEnable": False,
            "PtpStatus": "Slave",
            **features,
        }
        self.written = {"ActionDeviceKey"}  # can be set and never read
        self.rounds = {}
        self.log = []
        self.followers = []
        self.ring = deque()
        self.came = threading.Condition()
        self.number = first_frame_id
        self.seconds = 0.0
        self.acquiring = self.opened = self.gone = False
        self.ready = True
        self.lent = 0
        self.capacity = 0
        self.alters = lambda buffer: buffer

    def open(self):
        if self.gone:
            raise VendorError("no answer")
        self.opened = True
        return self.seen

    def lost(self):
        return self.gone

    def close(self):
        self.opened = False
        self.stop()

    def get(self, name):
        if self.gone:
            raise VendorError("device removed")
        return self.features.get(name)

    def set(self, name, value):
        if self.gone:
            raise VendorError("device removed")
        self.log.append((name, value))
        if name in self.written:
            return
        if name not in self.features:
            raise LookupError(name)
        if isinstance(value, float) and not 10.0 <= value <= 1e6 and name == "ExposureTime":
            raise VendorError("out of range")
        self.features[name] = self.rounds.get(name, lambda same: same)(value)

    def limits(self, name):
        return {"Width": (1.0, WIDTH), "Height": (1.0, HEIGHT), "ExposureTime": (10.0, 1e6)}.get(name)

    def choices(self, name):
        return {"PixelFormat": ("Mono8", "Mono12", "Mono16")}.get(name, ())

    def execute(self, name):
        self.log.append(name)
        if self.gone:
            raise VendorError("device removed")
        if name == "TriggerSoftware":
            self.expose()
            if self.features["LineSource"] == "ExposureActive":
                for follower in self.followers:
                    follower.expose()

    def start(self, buffers):
        self.acquiring, self.capacity, self.number = True, buffers, self.first_frame_id
        self.ring.clear()

    def wait_ready(self, timeout_s):
        self.log.append("ready?")
        return self.ready

    def retrieve(self, timeout_s):
        with self.came:
            self.came.wait_for(lambda: self.ring or not self.acquiring, timeout_s)
            if not self.ring:
                return None
            self.lent += 1
            return self.ring.popleft()

    def stop(self):
        with self.came:
            self.acquiring = False
            self.ring.clear()
            self.came.notify_all()

    def fire(self, action):
        self.log.append(action)
        for follower in (self, *self.followers):
            follower.expose()

    def expose(self):
        """What a trigger does to a camera that waits for one."""
        number, self.number = self.number, self.number + 1
        with self.came:
            if self.acquiring and self.lent + len(self.ring) < self.capacity:
                self.put(number)

    def put(self, number):
        buffer = self.alters(
            Buffer(
                frame_id=number,
                timestamp_s=100.0 + self.seconds,
                pixel_format=self.features["PixelFormat"],
                width=self.features["Width"],
                height=self.features["Height"],
                padding=0,
                data=np.full(4 * WIDTH * HEIGHT, number + 1, np.uint8),
                problem=None,
                release=self.release,
            )
        )
        if buffer is not None:
            with self.came:
                self.ring.append(buffer)
                self.came.notify_all()

    def release(self):
        self.lent -= 1


def options(**changed):
    return GenICamOptions(**{"cameras": {"head_1": ("4711", "4712")}, **changed})


def camera_of(device, leads=False, wanted="4711", **changed):
    return GenICamCamera(NAME, wanted, options(**changed), lambda: device, leads)
