"""Correspondence and triangulation: from places in two images to points."""
