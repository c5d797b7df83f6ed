"""Other learners and planners that use the model, on the same compiled equations as the learners of this project."""
