"""Extensions: each imports the core and lower extensions, and the core imports none of them."""
