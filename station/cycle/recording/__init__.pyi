from .held import Closing as Closing
from .held import Held as Held
from .ledger import Ledger as Ledger
from .master_duty import MasterDuty as MasterDuty
from .master_duty import Masters as Masters
from .record import cycle_record as cycle_record
from .record import evaluated as evaluated
from .record import run_out_notes as run_out_notes
