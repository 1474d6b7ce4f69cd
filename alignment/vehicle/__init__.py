"""Camber, toe, axle and vehicle angles, from wheel axes alone."""
