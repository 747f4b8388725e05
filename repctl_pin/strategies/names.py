"""Names and labels of the strategies that a study compares."""

LABELS = {
    "pseudoinverse": "J⁺",
    "posture": "J⁺ + posture",
    "posture_off": "J⁺ + other posture",
    "repeatable": "nearest repeatable",
}
"""Label of each strategy, by its name in files."""

KEYS = {label: key for key, label in LABELS.items()}
"""Name in files of each strategy, by its label."""
