from .health import ThreadHealth as ThreadHealth
from .health import ThreadWatch as ThreadWatch
from .health import Watched as Watched
from .supervised import SupervisedThread as SupervisedThread
from .worker import Worker as Worker
from .worker import WorkerError as WorkerError
