"""Control loops: the governor, the torque law, and export to C."""

from ...plugins import Extension

EXTENSION = Extension(
    __name__,
    names={
        "codegen.export": "export_c",
        "clutch": "Clutch",
        "governor": "Governor Status",
        "impedance": "LeafImpedance",
    },
    commands={"export": "export_command"},
)
