"""The web viewer: robots, human, warnings, edges and simulation on one page that needs no network.

The same page is a file (`Viewer.save`), is served (`serve`) or is shown in a notebook's cell. It was built once, with three.js
for the scene and uPlot for the curves, rather than a second time on a viewer's library for the served case.
"""

from robot_retarget.tools.view.web.page import Viewer as Viewer
from robot_retarget.tools.view.web.page import view as view
from robot_retarget.tools.view.web.take import Human as Human
from robot_retarget.tools.view.web.take import Take as Take
from robot_retarget.tools.view.web.take import file_names as file_names
from robot_retarget.tools.view.web.take import take_of as take_of
