"""What other programs say of the model of a lens, in whatever key: other models than Brown's are refused.

The names are those of OpenCV, ROS, Kalibr, OpenVINS, VINS-Fusion, ORB-SLAM and Basalt.
"""

from __future__ import annotations

import re
from os import PathLike

from alignment.errors import FormatError

_LENS_KEY = re.compile(
    r"(?:distortion|camera|lens|projection|calibration)_?(?:model|type)|model(?:_?type)?|type|projection"
    r"|distortion|(?:is_?)?fisheye(?:_?model)?|omni(?:directional)?",
    re.IGNORECASE,
)
_OTHER_LENS = re.compile(
    r"fish_?eye|equi_?dist|equi_?sol|(?:^|_)equi(?:_|$)|kannala|brandt|^kb\d?$|omni|(?:^|_)mei(?:_|$)|catadioptric"
    r"|double_?sphere|^ds$|(?:^|_)fov(?:_|$)|atan|unified|^e?ucm$|scaramuzza|ocam|stereographic|orthographic"
    r"|spherical|panoram|cahvor|division|f_?theta|mirror|inverse_?brown|modified_?brown",
    re.IGNORECASE,
)
_BROWN = re.compile(
    r"|none|no_?distortion|pinhole|perspective|plumb_?bob|rad_?tan|radial_?tangential|rational_?polynomial"
    r"|brown(?:_?conrady)?|opencv\d*|standard|polynomial|thin_?prism|full_?opencv|radial",
    re.IGNORECASE,
)
_MIRROR_KEYS = {"xi", "mirror_parameters"}


def refuse_other_lenses(values: object, file: str | PathLike[str], place: str = "") -> None:
    """Refuse what states a lens that is none of Brown and Conrady's: its coefficients mean something else.

    Parameters
    ----------
    values
        Maps and lists as the file holds them, searched to the bottom.
    file, place
        Named in the message.

    Raises
    ------
    FormatError
        When a key for the model of lens or distortion names another one, or a switch for fisheye is on, or a
        key is there that only mirrors have.
    """
    if isinstance(values, list):
        for n, item in enumerate(values):
            refuse_other_lenses(item, file, f"{place}[{n}]")
    if not isinstance(values, dict):
        return
    for key, value in values.items():
        name = str(key)
        field = f"{place}.{name}" if place else name
        if _states_other_lens(name.rsplit(".", 1)[-1].strip(), value):
            raise FormatError(
                file=file,
                field=field,
                expected="a lens of Brown and Conrady's model (OpenCV's k1 k2 p1 p2 k3 …): Truewheel has no "
                "fisheye lenses and none with a mirror",
                seen=f"'{value}'" if isinstance(value, str | int | float) else f"the key '{name}'",
                cure="Calibrate the camera with that model: another one's coefficients mean other things",
            )
        refuse_other_lenses(value, file, field)


def _states_other_lens(key: str, value: object) -> bool:
    if key.lower() in _MIRROR_KEYS:
        return True
    if _LENS_KEY.fullmatch(key) is None:
        return False
    if isinstance(value, str):
        text = re.sub(r"[\s-]+", "_", value.strip())
        # A model of distortion that nobody here knows is no reason to take it for this one.
        strange = key.lower().startswith("distortion") and _BROWN.fullmatch(text) is None
        return strange or _OTHER_LENS.search(text) is not None
    return "fisheye" in key.lower() or "omni" in key.lower() if value else False
