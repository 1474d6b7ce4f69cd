from .orders import PlcOrder as PlcOrder
from .orders import PlcResult as PlcResult
from .orders import PlcTimeouts as PlcTimeouts
from .simulator import PlcSimulator as PlcSimulator
from .simulator import run_plc as run_plc
from .sweeping import say_step as say_step
from .sweeping import turn_steering as turn_steering
from .teller import VehicleTeller as VehicleTeller
