"""Pictures of human and robot side by side: image strips and films.

They need Pillow and, for films, imageio-ffmpeg: the extra `video`. Without off-screen OpenGL
(EGL, OSMesa) figures are drawn instead of rendered; a missing picture is returned as `Unavailable`.
"""

from robot_retarget.tools.view.gif import gif as gif
from robot_retarget.tools.view.loop import AnimatedWebP as AnimatedWebP
from robot_retarget.tools.view.loop import loop as loop
from robot_retarget.tools.view.picture import Picture as Picture
from robot_retarget.tools.view.picture import Unavailable as Unavailable
from robot_retarget.tools.view.strip import strip as strip
from robot_retarget.tools.view.video import Film as Film
from robot_retarget.tools.view.video import video as video
