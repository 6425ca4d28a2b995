"""Every tolerance that more than one part of hqp must agree on, once: its unit and its use.

The native parts get theirs through the options of the Python class that calls them.  A constant that belongs to one
algorithm alone stands beside it.
"""

from __future__ import annotations

ROUNDING = 4e-15
"""Share of a problem's longest row: rows shorter than this fraction are rounding noise, no solver follows them."""

RANK_TOLERANCE = 1e-9
"""Share of the largest one: pivots and singular values below this fraction count as zero (solvers, contacts,
dynamics)."""

CERTIFIED_RANK_TOLERANCE = 1e-10
"""Rows of unit length add a fixed direction above this singular value: the smallest that is no rounding."""

EITHER_RANK = 10.0
"""A singular value within this factor of CERTIFIED_RANK_TOLERANCE may be a direction or none: one reading must pass."""

NULL_SPACE_ROUNDING = 4e-15
"""Rounding of a row's terms and of rows of unit length; a gap has it times their multipliers, and over the shortest
direction they fix."""

LARGEST_ROUNDING = 5e-7
"""Largest effect of rounding on a gap, for any length of a direction."""

GRADED_ROWS = 1e-2
"""A level with a row shorter than this, relative to its longest, is judged row by row (hqp/problem/graded.py)."""

FLAT_ROW = 1e-9
"""A row of unit length of which less is left adds no direction to least squares over sorted rows."""

CLEAR_DIRECTION = 1e-7
"""Share of a level's longest row: a longer direction that the levels above leave it is one to every solver."""

METRIC_TOLERANCE = 1e-10
"""Share of its largest diagonal entry: pivots of the metric below this fraction count as zero."""

UNSEEN_BY_METRIC = 1e-13
"""Share of its longest row: a metric that is no longer than this along directions that no level sees does not see
them."""

INERTIA_TOLERANCE = 1e-12
"""Least eigenvalue of the inertia, its diagonal scaled to one, that Torque takes."""

MULTIPLIER_TOLERANCE = 1e-11
"""Share of the level's gradient: a multiplier below this fraction has no sign."""

FEASIBILITY_TOLERANCE = 1e-11
"""Share of the terms of a row: a bound exceeded by less than this fraction is met while solving."""

VIOLATION_TOLERANCE = 1e-8
"""A constraint row counts as violated above this slack [unit of the row], relative to 1 + |bound|, and
FEASIBILITY_TOLERANCE of its length times ||x||: no solve meets it better."""

ACTIVITY_TOLERANCE = 1e-9
"""An inequality row counts as active within this distance of its bound [unit of the row], relative to 1 + |bound|."""

MET_TOLERANCE = 1e-10
"""Share of the terms of a row or level: a residual below this fraction is zero."""

ACCURATE = 1e-8
"""Share of a row's terms and of a gradient: an end of a stage that is off by more is in doubt, an answer whose gap is
more is no optimum."""

RESTING = 1e-4
"""Share of x's largest entry, or of one: least size of an entry in the size of a row's terms."""

ROUNDED = 1e-11
"""Share of a row's length: rounding of a row that depends on others, such as rows on forces, which are products."""

SOFTNESS = 1e-5
"""Largest excess of constraint rows by the completion, as a share of x (hqp/problem/completion.py).

An error e of a row moves x by at most e / (2 SOFTNESS). Rows on forces have errors of 1e-13 to 1e-12 of 1e3 N, which
then move torques by less than 1e-6 of the largest."""

ZERO_RESIDUAL = 1e-7
"""Share of 1 + the request, in the element's own units: a smaller residual is reported as met."""

NEAR = 0.02
"""[unit of motion] an inequality that binds only in a stage holds its level back where it is this close to rest.

One further away, such as a window of acceleration, bounds how fast the level is met, not how far: its share counts for
the price, which would have held it in the end."""

FLAT_TOLERANCE = 1e-7
"""Directions without motion get this fraction of the largest column of F, so that the least ||x|| is taken there."""

LOCK_TOLERANCE = 1e-5
"""The certificate takes a met row as fixed for the levels below above this relative multiplier."""

SMALLEST_LOCK = 1e-13
"""From here to LOCK_TOLERANCE the certificate tries both readings of a multiplier, fixed and free: one must pass."""
