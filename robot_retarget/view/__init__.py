"""Pictures: the human beside the robot, as an image strip and as a film.

They need Pillow and, for films, imageio-ffmpeg: the extra `video`. Where there is no OpenGL off screen
(EGL, OSMesa) figures are drawn instead of rendered; what cannot be shown at all comes back as `Unavailable`.
"""

from robot_retarget.view.gif import gif as gif
from robot_retarget.view.picture import Picture as Picture
from robot_retarget.view.picture import Unavailable as Unavailable
from robot_retarget.view.strip import strip as strip
from robot_retarget.view.video import Film as Film
from robot_retarget.view.video import video as video
