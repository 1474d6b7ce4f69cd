from .cameras import CameraModel as CameraModel
from .cameras import PosedCamera as PosedCamera
from .distortion import unproject_pixel as unproject_pixel
from .transforms import RigidTransform as RigidTransform
