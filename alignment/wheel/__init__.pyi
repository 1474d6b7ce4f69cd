from .reference import spin_reference as spin_reference
from .revolution import RevolutionFit as RevolutionFit
from .revolution import fit_revolution as fit_revolution
from .revolution import least_covariance as least_covariance
from .spin import SpinMeasurement as SpinMeasurement
from .zero import ZeroCorrection as ZeroCorrection
from .zero import zero_correction as zero_correction
