"""The published layout of the MITO dataset, both ways: its door. Everything that others need of it, in one place.

`mito_names`: which folder and file is what. `mito_setup`: radars, frames and grids of the experiments. `mito_files`:
images, masks and camera frames. `mito_raw`: raw captures read. `mito_record`: raw captures written.
"""

from millisight.io.mito_files import read_published as read_published
from millisight.io.mito_files import write_published as write_published
from millisight.io.mito_names import experiment_folder as experiment_folder
from millisight.io.mito_names import is_experiment as is_experiment
from millisight.io.mito_names import radar_folder as radar_folder
from millisight.io.mito_raw import read_experiment as read_experiment
from millisight.io.mito_record import write_raw_experiment as write_raw_experiment
from millisight.io.mito_setup import experiment_radar as experiment_radar
from millisight.io.mito_setup import published_grid as published_grid
from millisight.io.mito_setup import read_info as read_info
