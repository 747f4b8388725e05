"""Problems, each complete, and studies: all strategies side by side on one problem."""
