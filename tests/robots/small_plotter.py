"""Test support: the rig file of a small plotter."""


def small_plotter(port: str = "/dev/null", canvas_mm: tuple[int, int] = (100, 100)) -> str:
    """The text of a rig file: a GRBL plotter at a port, with a canvas of this size."""
    return f"""
name = "small"
driver = "grbl"
canvas = ["{canvas_mm[0]} mm", "{canvas_mm[1]} mm"]
[canvas_to_robot]
origin = ["20 mm", "20 mm", "-10 mm"]
turn = ["0 deg", "0 deg", "0 deg"]
[reach]
low = ["0 mm", "0 mm", "-14 mm"]
high = ["380 mm", "280 mm", "0 mm"]
[travel]
height = "5 mm"
speed = "80 mm/s"
[machine]
port = "{port}"
baud = 115200
pen = "z"
"""
