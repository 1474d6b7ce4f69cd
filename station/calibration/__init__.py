"""A calibration's life: made with the plate, checked, put in the vehicle frame, refreshed, zeroed."""
