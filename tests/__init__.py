import pytest

pytest.register_assert_rewrite("tests.lab")  # it asserts as tests do
