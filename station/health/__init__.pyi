from .figures import Figure as Figure
from .limits import HealthLimits as HealthLimits
from .observer import WatchingObserver as WatchingObserver
from .watch import CameraWatch as CameraWatch
from .watch import WatchedCamera as WatchedCamera
