"""Control loops: the governor, the torque law, and export to C."""

from ...plugins import Extension

EXTENSION = Extension(
    __name__,
    names={
        "codegen.compile": "compiled",
        "codegen.export": "export_c",
        "governor": "Governor",
        "impedance": "LeafImpedance",
        "status": "Status",
    },
    commands={"export": "export_command"},
)
