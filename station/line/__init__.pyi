from .interface import StationLine as StationLine
