from .archive import ArchivingObserver as ArchivingObserver
from .archive import ImageArchive as ImageArchive
from .opening import StationStore as StationStore
from .opening import archive_policy as archive_policy
from .opening import describe_station as describe_station
from .opening import open_archive as open_archive
from .opening import open_store as open_store
