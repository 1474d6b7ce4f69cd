from .answers import Standing as Standing
from .answers import answers_of as answers_of
from .answers import axle_records as axle_records
from .answers import last_measured as last_measured
from .answers import vehicle_record as vehicle_record
from .answers import wheel_records as wheel_records
from .contradiction import as_told as as_told
from .contradiction import contradicts as contradicts
