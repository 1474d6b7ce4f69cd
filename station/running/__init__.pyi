from .app import run_station as run_station
from .app import stop_on_signals as stop_on_signals
from .cameras import make_rig as make_rig
from .cameras import read_rig_calibration as read_rig_calibration
from .checking import check_configuration as check_configuration
from .composition import OpenStation as OpenStation
from .composition import open_station as open_station
from .light import with_light as with_light
