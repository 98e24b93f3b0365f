"""Answers of commands equal the stored ones: a net over all that a user reads."""

from references import comparison

test_an_answer_is_the_stored_one = comparison("trim/hfa")
