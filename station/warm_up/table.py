"""Compiled functions by the work that needs them; written by tools/kernel_table.py.

A test measures with everything of this table loaded and asserts that nothing else is compiled.
"""

# ruff: noqa: E501

from __future__ import annotations

SIGNATURES: dict[str, dict[str, tuple[str, ...]]] = {
    "calibrate": {
        "alignment.calibration.contour.contour_shift": (
            "float64[::1]; float64[::1]; float64[::1]; float64; float64[::1]",
        ),
        "alignment.calibration.dense.eliminate": (
            "float64[:, ::1]; float64[::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]",
        ),
        "alignment.calibration.dense.leverage": (
            "int64[:, ::1]; int64[::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]",
        ),
        "alignment.calibration.equations._accumulate": (
            "int64[:, ::1]; int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[::1]; int64; int64",
        ),
        "alignment.calibration.equations._linearise": (
            "int64[::1]; int64[::1]; int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, ::1]",
        ),
        "alignment.geometry.symmetric.solve": ("float64[:, ::1]; float64[:, ::1]; float64",),
        "alignment.imaging.mark_ellipse.fit_ellipses": (
            "uint8[:, ::1]; float64[:, ::1]; boolean[::1]; float64",
        ),
        "alignment.imaging.mark_ellipse.start_values": (
            "uint8[:, ::1]; float64[:, ::1]; float64[:, :, :]; float64[::1]",
        ),
    },
    "deformed_wheel_images": {
        "sensors.simulation.projector.may_light": ("float64[:, ::1]; float64; int64; float64[:, ::1]",),
        "sensors.simulation.shading.shade_cells": (
            "int64; int64; uint8[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; float64[::1]; float64[::1]; Array(float64, 2, 'C', True); named('sensors.simulation.surface.Surface', float64[::1], float64[::1], float32[:, ::1], boolean[:, ::1], float64[:, ::1]); named('sensors.simulation.shading.Skin', float32[:, ::1], float64[::1]); named('sensors.simulation.shading.Light', float64[:, ::1], float64[:, :, ::1], float64[::1]); int64; float32[:, ::1]",
        ),
        "sensors.simulation.shading.shade_facets": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[:, ::1]; int64[::1]; float64[::1]; named('sensors.simulation.shading.Light', float64[:, ::1], float64[:, :, ::1], float64[::1])",
        ),
        "sensors.simulation.shading.shade_wheel_rays": (
            "float64[:, ::1]; float64[::1]; int64[::1]; float64[::1]; named('sensors.simulation.surface.Surface', float64[::1], float64[::1], float32[:, ::1], boolean[:, ::1], float64[:, ::1]); named('sensors.simulation.shading.Skin', float32[:, ::1], float64[::1]); named('sensors.simulation.shading.Light', float64[:, ::1], float64[:, :, ::1], float64[::1])",
        ),
    },
    "measure_16": {
        "alignment.calibration.judgement_kernels.evidences": (
            "float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]",
        ),
        "alignment.calibration.judgement_kernels.knock_axes": ("float64[:, ::1]; float64[:, ::1]",),
        "alignment.calibration.judgement_kernels.patch_signs": (
            "float64[:, ::1]; float64[::1]; float64; float64[::1]",
        ),
        "alignment.calibration.judgement_kernels.row_figures": (
            "int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, :, ::1]",
        ),
        "alignment.calibration.judgement_kernels.together": (
            "float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, :, :, ::1]",
        ),
        "alignment.calibration.judgement_kernels.unseen": ("float64[:, ::1]; float64[:, :, ::1]",),
        "alignment.calibration.judgement_kernels.whitened": (
            "float64[::1]; float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, ::1]",
        ),
        "alignment.calibration.prediction._derivatives": (
            "float64[:, ::1]; Array(float64, 2, 'C', True); float64[::1]",
        ),
        "alignment.geometry.distortion.project_many": ("float64[:, ::1]; float64[::1]",),
        "alignment.geometry.distortion.unproject_many": ("float64[:, ::1]; float64[::1]",),
        "alignment.imaging.extraction.extract_all": (
            "ListType(uint16[:, ::1]); int64[:, ::1]; int64; float64[:, ::1]; float64; boolean; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, :, ::1]; int64[:, ::1]; float64[:, :, ::1]; int64[:, ::1]",
        ),
        "alignment.imaging.extraction.level_share": ("uint16[:, ::1]; float64[:, :]; int64",),
        "alignment.imaging.strips._look": (
            "uint16[:, ::1]; int64[::1]; float64[::1]; int64[::1]; int64; float64; UniTuple(float64, 2); float64[::1]; float64[:, ::1]; float64[:, ::1]; float64[:, ::1]; int64[::1]; int64[::1]",
        ),
        "alignment.stereo.correspondence._match_all": (
            "float64[:, ::1]; int64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64[::1]; int64[::1]; int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[::1]; UniTuple(float64, 2); float64; float64[::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; int64[:, :, ::1]; int64[:, ::1]",
        ),
        "alignment.stereo.correspondence.line_slopes": ("float64[:, ::1]; int64[::1]; float64[::1]",),
        "alignment.stereo.paired._match_again": (
            "float64[::1]; int64[::1]; int64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64[:, ::1]; float64; float64[::1]; int64[::1]; int64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64; int64[::1]; float64[::1]; float64; float64[:, ::1]; float64[::1]; float64; float64; float64; float64; float64; float64[:, ::1]; float64[:, ::1]; float64[::1]; float64[::1]; float64[:, ::1]; int64[:, ::1]; int64[::1]; int64",
        ),
        "alignment.stereo.pool._take_rows": ("boolean[::1]; float64[:, ::1]",),
        "alignment.stereo.pool.take_numbers": ("boolean[::1]; int64[::1]",),
        "alignment.stereo.pool.take_points": (
            "boolean[::1]; float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[::1]",
        ),
        "alignment.stereo.rectification.rectify": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[:, ::1]",
        ),
        "alignment.stereo.row_kernels.cross_pairs": (
            "int64[::1]; int64[::1]; float64[:, ::1]; int64[:, ::1]; float64[:, ::1]; int64[:, ::1]; int64[::1]; int64[::1]; boolean[::1]; float64[:, ::1]; float64[:, :, ::1]; float64; float64[:, ::1]; int64",
        ),
        "alignment.stereo.row_kernels.fit_fields": (
            "float64[:, ::1]; float64[::1]; boolean[::1]; int64[::1]",
        ),
        "alignment.stereo.row_kernels.pair_figures": (
            "float64[:, ::1]; int64[::1]; float64[:, :, ::1]; float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[::1]; float64[::1]",
        ),
        "alignment.stereo.surface._grow_all": (
            "float64[:, ::1]; int64[:, ::1]; float64[::1]; float64[::1]; float64; float64",
        ),
        "alignment.stereo.surface.nearest_candidates": ("float64[::1]; int64[::1]; float64",),
        "alignment.wheel.agreement._condensed": (
            "float64[:, ::1]; int64[::1]; int64; float64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64; float64; float64[::1]",
        ),
        "alignment.wheel.agreement._explained": (
            "float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[::1]",
        ),
        "alignment.wheel.agreement.head_sums": ("int64[::1]; int64; float64[::1]; float64[::1]",),
        "alignment.wheel.disturbance.undisturbed": ("float64[::1]; boolean[::1]; int64[::1]; float64",),
        "alignment.wheel.gloss.gloss_shifts": (
            "float64[:, ::1]; int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[::1]; float64[::1]",
        ),
        "alignment.wheel.held_load._look_up": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64; float64[:, ::1]",
        ),
        "alignment.wheel.revolution_kernels.cluster_pulls": (
            "float64[:, ::1]; int64[::1]; int64[::1]; int64; float64[:, ::1]",
        ),
        "alignment.wheel.revolution_kernels.heights": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64; float64; float64[::1]",
        ),
        "alignment.wheel.revolution_kernels.local_medians": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64",
        ),
        "alignment.wheel.revolution_kernels.pieces_of": ("float64[::1]",),
        "alignment.wheel.revolution_steps.frame_of": ("float64[::1]",),
        "alignment.wheel.revolution_steps.iterate": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64; float64; float64[::1]; float64; float64; float64; int64; float64; boolean; float64[:, ::1]; int64[::1]",
        ),
        "alignment.wheel.revolution_steps.matrix_of": ("float64[:, ::1]; int64[::1]; int64",),
        "alignment.wheel.revolution_steps.solve_arrow": (
            "float64[:, ::1]; float64[:, ::1]; float64[:, ::1]; float64[:, ::1]",
        ),
    },
    "measure_8": {
        "alignment.calibration.judgement_kernels.evidences": (
            "float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]",
        ),
        "alignment.calibration.judgement_kernels.knock_axes": ("float64[:, ::1]; float64[:, ::1]",),
        "alignment.calibration.judgement_kernels.patch_signs": (
            "float64[:, ::1]; float64[::1]; float64; float64[::1]",
        ),
        "alignment.calibration.judgement_kernels.row_figures": (
            "int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, :, ::1]",
        ),
        "alignment.calibration.judgement_kernels.together": (
            "float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, :, :, ::1]",
        ),
        "alignment.calibration.judgement_kernels.unseen": ("float64[:, ::1]; float64[:, :, ::1]",),
        "alignment.calibration.judgement_kernels.whitened": (
            "float64[::1]; float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, ::1]",
        ),
        "alignment.calibration.prediction._derivatives": (
            "float64[:, ::1]; Array(float64, 2, 'C', True); float64[::1]",
        ),
        "alignment.geometry.distortion.project_many": ("float64[:, ::1]; float64[::1]",),
        "alignment.geometry.distortion.unproject_many": ("float64[:, ::1]; float64[::1]",),
        "alignment.imaging.extraction.extract_all": (
            "ListType(uint8[:, ::1]); int64[:, ::1]; int64; float64[:, ::1]; float64; boolean; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, :, ::1]; int64[:, ::1]; float64[:, :, ::1]; int64[:, ::1]",
        ),
        "alignment.imaging.extraction.level_share": ("uint8[:, ::1]; float64[:, :]; int64",),
        "alignment.imaging.strips._look": (
            "uint8[:, ::1]; int64[::1]; float64[::1]; int64[::1]; int64; float64; UniTuple(float64, 2); float64[::1]; float64[:, ::1]; float64[:, ::1]; float64[:, ::1]; int64[::1]; int64[::1]",
        ),
        "alignment.stereo.correspondence._match_all": (
            "float64[:, ::1]; int64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64[::1]; int64[::1]; int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[::1]; UniTuple(float64, 2); float64; float64[::1]; float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; int64[:, :, ::1]; int64[:, ::1]",
        ),
        "alignment.stereo.correspondence.line_slopes": ("float64[:, ::1]; int64[::1]; float64[::1]",),
        "alignment.stereo.paired._match_again": (
            "float64[::1]; int64[::1]; int64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64[:, ::1]; float64; float64[::1]; int64[::1]; int64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64; int64[::1]; float64[::1]; float64; float64[:, ::1]; float64[::1]; float64; float64; float64; float64; float64; float64[:, ::1]; float64[:, ::1]; float64[::1]; float64[::1]; float64[:, ::1]; int64[:, ::1]; int64[::1]; int64",
        ),
        "alignment.stereo.pool._take_rows": ("boolean[::1]; float64[:, ::1]",),
        "alignment.stereo.pool.take_numbers": ("boolean[::1]; int64[::1]",),
        "alignment.stereo.pool.take_points": (
            "boolean[::1]; float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[::1]",
        ),
        "alignment.stereo.rectification.rectify": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[:, ::1]",
        ),
        "alignment.stereo.row_kernels.cross_pairs": (
            "int64[::1]; int64[::1]; float64[:, ::1]; int64[:, ::1]; float64[:, ::1]; int64[:, ::1]; int64[::1]; int64[::1]; boolean[::1]; float64[:, ::1]; float64[:, :, ::1]; float64; float64[:, ::1]; int64",
        ),
        "alignment.stereo.row_kernels.fit_fields": (
            "float64[:, ::1]; float64[::1]; boolean[::1]; int64[::1]",
        ),
        "alignment.stereo.row_kernels.pair_figures": (
            "float64[:, ::1]; int64[::1]; float64[:, :, ::1]; float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[::1]; float64[::1]",
        ),
        "alignment.stereo.surface._grow_all": (
            "float64[:, ::1]; int64[:, ::1]; float64[::1]; float64[::1]; float64; float64",
        ),
        "alignment.stereo.surface.nearest_candidates": ("float64[::1]; int64[::1]; float64",),
        "alignment.wheel.agreement._condensed": (
            "float64[:, ::1]; int64[::1]; int64; float64[::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64; float64; float64[::1]",
        ),
        "alignment.wheel.agreement._explained": (
            "float64[:, :, ::1]; float64[:, :, ::1]; float64[:, ::1]; float64[::1]",
        ),
        "alignment.wheel.agreement.head_sums": ("int64[::1]; int64; float64[::1]; float64[::1]",),
        "alignment.wheel.disturbance.undisturbed": ("float64[::1]; boolean[::1]; int64[::1]; float64",),
        "alignment.wheel.gloss.gloss_shifts": (
            "float64[:, ::1]; int64[::1]; float64[:, ::1]; float64[:, :, ::1]; float64[::1]; float64[::1]",
        ),
        "alignment.wheel.held_load._look_up": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64; float64[:, ::1]",
        ),
        "alignment.wheel.revolution_kernels.cluster_pulls": (
            "float64[:, ::1]; int64[::1]; int64[::1]; int64; float64[:, ::1]",
        ),
        "alignment.wheel.revolution_kernels.heights": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64; float64; float64[::1]",
        ),
        "alignment.wheel.revolution_kernels.local_medians": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64",
        ),
        "alignment.wheel.revolution_kernels.pieces_of": ("float64[::1]",),
        "alignment.wheel.revolution_steps.frame_of": ("float64[::1]",),
        "alignment.wheel.revolution_steps.iterate": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[::1]; float64[::1]; float64[:, ::1]; float64; float64; float64[::1]; float64; float64; float64; int64; float64; boolean; float64[:, ::1]; int64[::1]",
        ),
        "alignment.wheel.revolution_steps.matrix_of": ("float64[:, ::1]; int64[::1]; int64",),
        "alignment.wheel.revolution_steps.solve_arrow": (
            "float64[:, ::1]; float64[:, ::1]; float64[:, ::1]; float64[:, ::1]",
        ),
    },
    "plate_images": {
        "sensors.simulation.board.board_radiance": (
            "float64[:, :, ::1]; Array(float64, 2, 'C', True); float64[::1]; float64[:, :, ::1]; int64[:, :, ::1]; float64[::1]; float64[::1]; float32[:, ::1]",
        ),
        "sensors.simulation.plate._plate_radiance": (
            "float64[:, :, ::1]; Array(float64, 2, 'C', True); float64[::1]; float64[:, ::1]; float64[:, ::1]; int64[:, ::1]; float64[::1]; float64[::1]; float32[:, ::1]",
        ),
    },
    "refresh": {
        "alignment.calibration.dense.products": (
            "float64[:, ::1]; float64[:, ::1]",
            "float64[:, ::1]; float64[::1, :]",
            "float64[::1, :]; float64[:, ::1]",
        ),
    },
    "spin": {},
    "wheel_images": {
        "sensors.simulation.projector.may_light": ("float64[:, ::1]; float64; int64; float64[:, ::1]",),
        "sensors.simulation.shading.shade_cells": (
            "int64; int64; uint8[:, ::1]; float64[:, ::1]; float64[:, :, ::1]; float64[::1]; float64[::1]; Array(float64, 2, 'C', True); named('sensors.simulation.surface.Surface', float64[::1], float64[::1], float32[:, ::1], boolean[:, ::1], none); named('sensors.simulation.shading.Skin', float32[:, ::1], float64[::1]); named('sensors.simulation.shading.Light', float64[:, ::1], float64[:, :, ::1], float64[::1]); int64; float32[:, ::1]",
        ),
        "sensors.simulation.shading.shade_facets": (
            "float64[:, ::1]; float64[::1]; float64[:, ::1]; float64[:, ::1]; int64[::1]; float64[::1]; named('sensors.simulation.shading.Light', float64[:, ::1], float64[:, :, ::1], float64[::1])",
        ),
        "sensors.simulation.shading.shade_wheel_rays": (
            "float64[:, ::1]; float64[::1]; int64[::1]; float64[::1]; named('sensors.simulation.surface.Surface', float64[::1], float64[::1], float32[:, ::1], boolean[:, ::1], none); named('sensors.simulation.shading.Skin', float32[:, ::1], float64[::1]); named('sensors.simulation.shading.Light', float64[:, ::1], float64[:, :, ::1], float64[::1])",
        ),
    },
}
