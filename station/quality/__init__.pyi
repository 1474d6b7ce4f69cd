from .periods import read_time as read_time
from .selection import newest_vin as newest_vin
from .selection import read_filter as read_filter
from .selection import read_zone as read_zone
from .text_tables import figure_table as figure_table
from .text_tables import shown as shown
from .text_tables import table as table
from .text_tables import terminal as terminal
