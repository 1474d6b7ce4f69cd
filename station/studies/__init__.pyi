from .covariance import measured_angles as measured_angles
from .following import tie_rod_images as tie_rod_images
from .registry import STUDIES as STUDIES
from .registry import load_study as load_study
from .simulated_views import SimulatedViews as SimulatedViews
from .simulated_views import ViewErrors as ViewErrors
from .simulated_views import observe as observe
from .simulated_views import square_plate as square_plate
