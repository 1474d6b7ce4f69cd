"""Rigid transforms, projective geometry, camera models."""
