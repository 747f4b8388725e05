"""Problems: robot, frame, kind of task, start, closed path and region Ω, checked and complete."""

from .around_motion import NO_BETTER as NO_BETTER
from .around_motion import design_for as design_for
from .around_motion import half_width_within as half_width_within
from .around_motion import own_failure as own_failure
from .around_motion import shrunk_note as shrunk_note
from .around_motion import timed_cycle as timed_cycle
from .desired import choose_desired as choose_desired
from .fitting_start import fitting_start as fitting_start
from .minimum_speed import at_minimum_speed as at_minimum_speed
from .of_design import problem_of as problem_of
from .period import PERIOD as PERIOD
from .period import choose_period as choose_period
from .problem import Problem as Problem
from .task_choice import kind_note as kind_note
from .task_choice import redundant_kinds as redundant_kinds
from .work import check_degree as check_degree
from .work import choose_degree as choose_degree
