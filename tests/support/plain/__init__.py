"""The plain numpy form of every kernel that has one; the others are their own loops, run by the interpreter."""

from support.plain.articulated import row_plain, separation_plain, write_bias_plain
from support.plain.cache import consume_clearance_plain
from support.plain.candidates import list_candidates_plain
from support.plain.collinear import first_of_lines_plain
from support.plain.contact_blocks import pack_contacts_plain, sweep_blocks_plain
from support.plain.goldfarb_idnani import goldfarb_idnani_plain
from support.plain.gram import gram_plain, islands_plain
from support.plain.half_space import half_space_rows_plain, points_below_plain
from support.plain.hull_graph import outermost_plain
from support.plain.impact_rows import _raise_levels_plain
from support.plain.incomplete_cholesky import incomplete_cholesky_plain, solve_factor_plain
from support.plain.joint_limit import _limits_within_plain
from support.plain.pairs import filter_active_plain
from support.plain.projected_pcg import projected_pcg_plain
from support.plain.recorder import _note_plain, _struck_plain
from support.plain.refinement import refine_subset_plain, solve_island_plain
from support.plain.robot_step import _law_of_rows_plain, _tree_law_plain, newton_law_plain, solve_active_set_plain
from support.plain.rows import mutual_nearest_plain
from support.plain.separating_axis import _clear_plain, _keep_plain, guess_axes_plain, reach_plain
from support.plain.shared_percussions import least_norm_plain
from support.plain.sparse_islands import solve_islands_plain
from support.plain.sphere_walls import wall_contacts_plain
from support.plain.spheres import pairs_within_plain
from support.plain.support_points import lowest_plain, stand_plain
from support.plain.tree import (
    _unwhiten_plain,
    _whiten_plain,
    advance_plain,
    factor_mass_plain,
    factor_plain,
    solve_plain,
)
from support.plain.triangles import (
    feature_normal_plain,
    mesh_contacts_plain,
    mesh_distances_plain,
    nearest_on_triangle_plain,
)
from support.plain.turning import (
    accelerations_plain,
    chart_rates_plain,
    differences_plain,
    moved_plain,
    placed_plain,
    pulled_in_plane_plain,
    pulled_plain,
)
from support.plain.verlet_list import _near_balls_plain, farthest_moved_plain

PLAIN = {
    "pack_contacts": pack_contacts_plain,
    "sweep_blocks": sweep_blocks_plain,
    "write_bias": write_bias_plain,
    "separated": _clear_plain,
    "guess_axes": guess_axes_plain,
    "first_of_lines": first_of_lines_plain,
    "keep_normals": _keep_plain,
    "_near_balls": _near_balls_plain,
    "farthest_moved": farthest_moved_plain,
    "record_depth": _note_plain,
    "_raise_levels": _raise_levels_plain,
    "reach": reach_plain,
    "_limits_within": _limits_within_plain,
    "_solve_islands": solve_islands_plain,
    "unwhiten": _unwhiten_plain,
    "whiten": _whiten_plain,
    "_choose_rows": _struck_plain,
    "half_space_rows": half_space_rows_plain,
    "pairs_within": pairs_within_plain,
    "wall_contacts": wall_contacts_plain,
    "accelerations": accelerations_plain,
    "advance_by": advance_plain,
    "consume_clearance": consume_clearance_plain,
    "chart_rates": chart_rates_plain,
    "differences": differences_plain,
    "factor": factor_plain,
    "factor_mass": factor_mass_plain,
    "filter_active": filter_active_plain,
    "goldfarb_idnani": goldfarb_idnani_plain,
    "gram": gram_plain,
    "incomplete_cholesky": incomplete_cholesky_plain,
    "islands": islands_plain,
    "mutual_nearest": mutual_nearest_plain,
    "newton_law": newton_law_plain,
    "least_norm": least_norm_plain,
    "list_candidates": list_candidates_plain,
    "lowest": lowest_plain,
    "refine_subset": refine_subset_plain,
    "integrate": moved_plain,
    "mesh_contacts": mesh_contacts_plain,
    "feature_normal": feature_normal_plain,
    "mesh_distances": mesh_distances_plain,
    "nearest_on_triangle": nearest_on_triangle_plain,
    "outermost": outermost_plain,
    "points_below": points_below_plain,
    "placements": placed_plain,
    "solve_active_set": solve_active_set_plain,
    "separation_rows": pulled_plain,
    "planar_separation_rows": pulled_in_plane_plain,
    "solve_island": solve_island_plain,
    "projected_pcg": projected_pcg_plain,
    "row": row_plain,
    "separation": separation_plain,
    "solve": solve_plain,
    "solve_factor": solve_factor_plain,
    "stand": stand_plain,
    "tree_law": _tree_law_plain,
    "law_of_rows": _law_of_rows_plain,
}
