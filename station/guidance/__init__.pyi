from .words import AdjusterKind as AdjusterKind
from .words import GuidanceState as GuidanceState
from .words import OutOfReach as OutOfReach
from .words import TurnDirection as TurnDirection
