from .needs import Work as Work
from .needs import missing as missing
from .notation import called as called
from .prepare import StoppedError as StoppedError
from .prepare import WarmedUp as WarmedUp
from .prepare import WarmUpProgress as WarmUpProgress
from .prepare import warm_up as warm_up
from .table import SIGNATURES as SIGNATURES
