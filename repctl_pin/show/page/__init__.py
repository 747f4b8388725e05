"""Animation page: a self-contained HTML file of meshcat's viewer and all data that it shows."""

# ruff: noqa: E402  (a package that is missing is named before it is imported)
from ...errors import needed

needed(
    "PIL",
    "collada",
    "jinja2",
    "meshcat",
    "tornado",
    "trimesh",
    "umsgpack",
    by="an animation",
)

from .meshes import key as key
from .playback import Playback as Playback
from .playback import TracedChain as TracedChain
from .playback import playback_of as playback_of
from .playback import playback_page as playback_page
from .playback import read_playbacks as read_playbacks
from .scene import Arm as Arm
from .scene import animation_page as animation_page
from .scene import choose_frames as choose_frames
from .scene import poses_of as poses_of
from .surfaces import MOST_BYTES as MOST_BYTES
from .surfaces import read_surface as read_surface
from .surfaces import smooth as smooth
