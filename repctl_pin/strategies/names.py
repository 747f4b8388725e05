"""What the strategies that are compared everywhere are called."""

LABELS = {
    "pseudoinverse": "J⁺",
    "posture": "J⁺ + posture",
    "posture_off": "J⁺ + other posture",
    "repeatable": "nearest repeatable",
}
"""By the names they have in files, what people call them."""

KEYS = {label: key for key, label in LABELS.items()}
"""And back."""
