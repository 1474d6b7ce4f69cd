from .figures import Figure as Figure
from .limits import HealthLimits as HealthLimits
from .observer import WatchingObserver as WatchingObserver
from .trend import Trend as Trend
from .trend import trends as trends
from .watch import CameraWatch as CameraWatch
from .watch import WatchedCamera as WatchedCamera
