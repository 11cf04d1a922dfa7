"""`millisight demo` in less time: for `python -c`, in a process of its own."""

SMALL_DEMO = """
import sys
import millisight as ms
from millisight.cli import demo, main
demo.OBJECTS, demo._SIZE = ("mug",), (0.15, 0.12)
ms.Scene.from_mesh.__kwdefaults__["vertices"] = 2000
sys.argv[1:] = ["demo", "-o", "demo"]
main.run()
"""
"""With one of its three objects, which need nothing of their own, coarser, and by a smaller scanner."""
