from .correspondence import StereoGeometry as StereoGeometry
from .correspondence import match_heads as match_heads
from .correspondence import match_lines as match_lines
from .rectification import Rectification as Rectification
from .rectification import epipolar_directions as epipolar_directions
from .triangulation import triangulate as triangulate
