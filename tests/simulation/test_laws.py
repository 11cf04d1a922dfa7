"""The laws of scattering, for every model of the simulator."""

from helpers.laws import ScatteringLaws


class TestSpecular(ScatteringLaws):
    model = "specular"


class TestEdge(ScatteringLaws):
    model = "edge"


class TestDiffuse(ScatteringLaws):
    model = "diffuse"


class TestRough(ScatteringLaws):
    model = "rough"
