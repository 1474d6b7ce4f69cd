"""One Basler camera behind `Device`: pylon's instant camera."""

from __future__ import annotations

import weakref
from dataclasses import replace
from typing import Any

import numpy as np

from alignment.errors import CameraConnectionError
from sensors.drivers.driver import SeenCamera
from sensors.drivers.genicam.device import NOTHING, Action, Buffer, FeatureValue
from sensors.drivers.genicam.pixels import name_of_format
from sensors.drivers.pylon.library import EMULATION, device_infos, load_pylon, seen_of

_GIGE, _USB = "BaslerGigE", "BaslerUsb"
_FIRST_FRAME_ID = {_GIGE: 1, _USB: 0, EMULATION: 0}
_NO_ID = 2**64 - 1
_STATUS = "AcquisitionStatusSelector"
_NANOSECONDS = 1e9
_LATCHES = (("TimestampLatch", "TimestampLatchValue"), ("GevTimestampControlLatch", "GevTimestampValue"))


class PylonDevice:
    """See `Device`.

    Parameters
    ----------
    name
        Of the camera in the station, for errors.
    wanted
        Serial number or user's name.
    device_class
        Of the transport in which it is looked for; None looks everywhere.
    """

    def __init__(self, name: str, wanted: str, device_class: str | None = None) -> None:
        self._name = name
        self._wanted = wanted
        self._class = device_class
        self._pylon = load_pylon()
        self._camera: Any = None
        self._kept: weakref.finalize[[Any], PylonDevice] | None = None
        self._info: Any = None
        self._nodes: Any = None
        self._ticks_per_s = _NANOSECONDS

    @property
    def first_frame_id(self) -> int:
        """1 with GigE Vision, 0 with the others."""
        return _FIRST_FRAME_ID.get(self._info.GetDeviceClass(), 0)

    def open(self) -> SeenCamera:
        """See `Device.open`."""
        camera = self._pylon.InstantCamera()
        kept = None if self._kept is None else self._kept.detach()
        self._kept = None
        if kept is not None:
            [device] = kept[2]
            camera.Attach(device)
            if camera.IsCameraDeviceRemoved():
                camera.DestroyDevice()
        if not camera.IsPylonDeviceAttached():
            camera.Attach(self._found())
        try:
            camera.Open()
        except Exception:
            camera.DestroyDevice()
            raise
        self._camera, self._nodes = camera, camera.GetNodeMap()
        frequency = self.get("GevTimestampTickFrequency")
        self._ticks_per_s = float(frequency) if isinstance(frequency, int | float) else _NANOSECONDS
        seen = seen_of(self._info)
        # What the camera itself says, not what the search said a moment ago.
        serial = self.get("DeviceSerialNumber") or self.get("DeviceID") or seen.serial_number
        return replace(seen, serial_number=str(serial))

    def _found(self) -> Any:
        """Search for the camera; the library's device, not open."""
        infos = device_infos(self._class)
        seen = [seen_of(info) for info in infos]
        index = next((n for n, one in enumerate(seen) if one.serial_number == self._wanted), None)
        if index is None:
            index = next((n for n, one in enumerate(seen) if one.user_name == self._wanted), None)
        if index is None:
            raise CameraConnectionError(
                self._name,
                f"expected a camera '{self._wanted}', pylon sees "
                f"{', '.join(one.serial_number for one in seen[:12]) or 'none'}",
                "Check its power, its cable and its address, and the serial number in the configuration",
            )
        self._info = infos[index]
        return self._pylon.TlFactory.GetInstance().CreateDevice(self._info)

    def lost(self) -> bool:
        """See `Device.lost`."""
        camera = self._camera
        return camera is not None and bool(camera.IsCameraDeviceRemoved())

    def close(self) -> None:
        """See `Device.close`."""
        camera, self._camera, self._nodes = self._camera, None, None
        if camera is not None:
            try:
                camera.StopGrabbing()
            finally:
                camera.Close()
                # Opened again if it can be: for each new device the library keeps 46 kB for ever.
                destroy = self._pylon.TlFactory.GetInstance().DestroyDevice
                self._kept = weakref.finalize(self, destroy, camera.DetachDevice())
                self._kept.atexit = False

    def get(self, name: str) -> FeatureValue | None:
        """See `Device.get`."""
        node = self._node(name)
        if node is None or not node.IsReadable():
            return None
        value: FeatureValue | None = None
        if isinstance(node, self._pylon.EnumParameter):
            value = str(node.ToString(False, True))
        elif not isinstance(node, (self._pylon.CommandParameter, self._pylon.CategoryParameter)):
            value = node.GetValue(False, True)
        return value

    def set(self, name: str, value: FeatureValue) -> None:
        """See `Device.set`."""
        node = self._node(name)
        if node is None:
            raise LookupError(name)
        node.SetValue(float(value) if isinstance(node, self._pylon.FloatParameter) else value)

    def limits(self, name: str) -> tuple[float, float] | None:
        """See `Device.limits`."""
        node = self._node(name)
        numbers = (self._pylon.FloatParameter, self._pylon.IntegerParameter)
        if not isinstance(node, numbers) or not node.IsReadable():
            return None
        return float(node.GetMin()), float(node.GetMax())

    def choices(self, name: str) -> tuple[str, ...]:
        """See `Device.choices`."""
        node = self._node(name)
        if not isinstance(node, self._pylon.EnumParameter):
            return ()
        return tuple(str(choice) for choice in node.GetSettableValues())

    def execute(self, name: str) -> None:
        """See `Device.execute`."""
        node = self._node(name)
        if node is None:
            raise LookupError(name)
        node.Execute()

    def start(self, buffers: int) -> None:
        """See `Device.start`."""
        self._camera.MaxNumBuffer.SetValue(buffers)
        if self.get(_STATUS) is not None:
            self.set(_STATUS, "FrameTriggerWait")
        self._camera.StartGrabbing(self._pylon.GrabStrategy_OneByOne)

    def wait_ready(self, timeout_s: float) -> bool:
        """See `Device.wait_ready`."""
        # Asked once, before the library waits, since it does so in steps of a millisecond.
        if self.get("AcquisitionStatus") is True or not self._camera.CanWaitForFrameTriggerReady():
            return True
        milliseconds = round(1e3 * timeout_s)
        return bool(self._camera.WaitForFrameTriggerReady(milliseconds, self._pylon.TimeoutHandling_Return))

    def retrieve(self, timeout_s: float) -> Buffer | None:
        """See `Device.retrieve`."""
        camera = self._camera
        if camera is None:
            return None
        result = camera.RetrieveResult(round(1e3 * timeout_s), self._pylon.TimeoutHandling_Return)
        if not result.IsValid():
            return None
        problem, data = None, NOTHING
        if result.GrabSucceeded():
            data = np.frombuffer(result.GetImageMemoryView(), np.uint8)
        else:
            code = result.GetErrorCode()
            problem = str(result.GetErrorDescription()) + (f" (code {code:#x})" if code else "")
        number = int(result.GetBlockID())
        known = number != _NO_ID and (number or not self.first_frame_id)
        return Buffer(
            frame_id=number if known else None,
            timestamp_s=result.GetTimeStamp() / self._ticks_per_s,
            pixel_format=name_of_format(result.GetPixelType()),
            width=result.GetWidth(),
            height=result.GetHeight(),
            padding=result.GetPaddingX(),
            data=data,
            problem=problem,
            release=result.Release,
        )

    def stop(self) -> None:
        """See `Device.stop`."""
        if self._camera is not None:
            self._camera.StopGrabbing()

    def fire(self, action: Action) -> None:
        """See `Device.fire`; by the network interfaces of the cameras."""
        factory = self._pylon.TlFactory.GetInstance()
        layer = factory.CreateTl(_GIGE)
        keys = (action.device_key, action.group_key, action.group_mask)
        try:
            if action.ahead_s:
                when = self._clock_now() + round(action.ahead_s * self._ticks_per_s)
                layer.ScheduledActionCommand(*keys, when, action.address).IssueNoWait()
            else:
                layer.ActionCommand(*keys, action.address).IssueNoWait()
        finally:
            factory.ReleaseTl(layer)

    def _clock_now(self) -> int:
        for command, value in _LATCHES:
            if self._node(command) is not None:
                self.execute(command)
                return int(self.get(value) or 0)
        raise LookupError(" or ".join(command for command, _ in _LATCHES))

    def _node(self, name: str) -> Any:
        nodes = self._nodes
        node = None if nodes is None else nodes.GetNode(name)
        return node if node is not None and node.IsValid() else None
