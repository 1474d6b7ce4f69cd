from .orders import PlcOrder as PlcOrder
from .orders import PlcResult as PlcResult
from .orders import PlcTimeouts as PlcTimeouts
from .simulator import PlcSimulator as PlcSimulator
from .simulator import run_plc as run_plc
