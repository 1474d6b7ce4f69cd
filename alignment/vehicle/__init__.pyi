from .angles import camber_toe as camber_toe
from .angles import normal_from_angles as normal_from_angles
from .axles import AxleAngles as AxleAngles
from .axles import ThrustSign as ThrustSign
from .axles import VehicleAngles as VehicleAngles
from .axles import WheelAngles as WheelAngles
from .axles import axle_angles as axle_angles
from .axles import vehicle_angles as vehicle_angles
