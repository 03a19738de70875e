"""Random buildings, each different, and drives through them whose truth is known.

``building(seed)`` makes a building, ``drive(building, seed)`` the observations of a robot in it, with poses such as
SLAM leaves them, in the building's frame: maps of all drives through one building are related by the identity.
"""

from mapgraft_recordings.buildings.building import Building, building
from mapgraft_recordings.buildings.driving import Drive, Sighting, drive, observations, record
from mapgraft_recordings.buildings.sensing import Sensor
from mapgraft_recordings.buildings.traits import KINDS, Traits

__all__ = ["KINDS", "Building", "Drive", "Sensor", "Sighting", "Traits", "building", "drive", "observations", "record"]
