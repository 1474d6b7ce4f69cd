"""What a person may choose of the statistics; nothing heavy is loaded, so a command line can name it."""

from __future__ import annotations

import enum


class RuleSet(enum.StrEnum):
    """Which signals a control chart gives."""

    THREE_SIGMA = "3sigma"
    WESTERN_ELECTRIC = "western-electric"
    NELSON = "nelson"


class ChartKind(enum.StrEnum):
    """What a control chart draws."""

    XBAR_R = "xbar-r"
    XBAR_S = "xbar-s"
    INDIVIDUALS = "individuals"


class Conclusion(enum.StrEnum):
    """What may be said of a process or a gauge that had to show something.

    Nothing that was not measured is shown: where the spread is a quotient of nothing by nothing, or values
    are too few, there is no verdict, and a reason.
    """

    SHOWN = "shown"
    NOT_SHOWN = "not shown"
    NONE = "no verdict"


class GrrMethod(enum.StrEnum):
    """How the components of a gauge study are found."""

    ANOVA = "anova"
    RANGE = "range"


class Contribution(enum.StrEnum):
    """What a standard uncertainty stands for, in the letters of VDA 5."""

    RESOLUTION = "RE"
    CALIBRATION = "CAL"
    MASTER_REPEATABILITY = "EVR"
    BIAS = "BI"
    LINEARITY = "LIN"
    SYSTEM_REST = "MS-REST"
    PART_REPEATABILITY = "EVO"
    APPRAISER = "AV"
    SYSTEMS = "GV"
    INTERACTION = "IA"
    STABILITY = "STAB"
    TEMPERATURE = "T"
    OBJECT = "OBJ"
    PROCESS_REST = "REST"
