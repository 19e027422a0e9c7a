import numpy as np
import pytest

from wackel_kinematics.array import cofactors

MATRIX = np.array(((2.0, -0.3, 0.5), (-0.3, 1.0, 0.2), (0.5, 0.2, 3.0)))


def test_cofactors_by_the_determinant_are_the_inverse() -> None:
    upper = np.triu_indices(3)
    found, determinant = cofactors(MATRIX[upper].tolist())
    assert determinant == pytest.approx(np.linalg.det(MATRIX))
    np.testing.assert_allclose(np.array(found) / determinant, np.linalg.inv(MATRIX)[upper])
