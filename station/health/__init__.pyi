from .figures import Figure as Figure
from .limits import HealthLimits as HealthLimits
from .observer import WatchingObserver as WatchingObserver
from .over_time import Trend as Trend
from .over_time import trends as trends
from .watch import CalibrationUsed as CalibrationUsed
from .watch import CameraWatch as CameraWatch
from .watch import WatchedCamera as WatchedCamera
