"""How topics were offered: the channel metadata ``offered_qos_profiles`` that the ROS 2 profile of MCAP requires.

All fields are there, with numbers for the policies: readers refuse profiles with fields left out.
"""

_PROFILE = """\
- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline: {{sec: 2147483647, nsec: 4294967295}}
  lifespan: {{sec: 2147483647, nsec: 4294967295}}
  liveliness: 1
  liveliness_lease_duration: {{sec: 2147483647, nsec: 4294967295}}
  avoid_ros_namespace_conventions: false
"""

LATCHED = _PROFILE.format(depth=1, durability=1)  # transient local: late listeners get the last one
STREAMED = _PROFILE.format(depth=100, durability=2)  # volatile
