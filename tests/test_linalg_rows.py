"""Rows and their entries: what indexing and stacking say, in batches and under every derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcontact.linalg.rows import entries_of_row, row_of


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int32, bool])
def test_entries_and_rows_are_those_of_numpy(dtype):
    x = np.array([[3, 0, 2], [0, 1, 5]]).astype(dtype)
    for apart in (entries_of_row, jax.jit(entries_of_row)):
        entries = apart(jnp.asarray(x))
        assert [e.dtype for e in entries] == [x.dtype] * 3
        np.testing.assert_array_equal(np.stack(entries, axis=-1), x)
    for together in (row_of, jax.jit(row_of)):
        np.testing.assert_array_equal(together([jnp.asarray(c) for c in x.T]), x)


def test_lanes_stay_in_front():
    """Also where the batch axis was last, and where only one entry has one."""
    x = np.arange(24.0).reshape(2, 3, 4)
    for k, found in enumerate(jax.vmap(jax.vmap(entries_of_row))(x)):
        np.testing.assert_array_equal(found, x[:, :, k])
    for k, found in enumerate(jax.vmap(entries_of_row, in_axes=2)(x)):
        np.testing.assert_array_equal(found, x[:, k].T)
    mixed = jax.vmap(lambda a, b: row_of([a, b]), in_axes=(1, None))(x[0], np.arange(3.0))
    np.testing.assert_array_equal(mixed, np.stack([x[0].T, np.broadcast_to(np.arange(3.0), (4, 3))], axis=-1))


def test_both_are_linear_and_each_the_transpose_of_the_other():
    x, y = np.array([1.0, -2.0, 4.0]), np.array([0.5, 3.0, -1.0])
    _, slopes = jax.jvp(entries_of_row, (x,), (y,))
    np.testing.assert_array_equal(slopes, y)
    _, slope = jax.jvp(lambda a: row_of([a, jnp.ones(()), a]), (2.0,), (1.0,))
    np.testing.assert_array_equal(slope, [1, 0, 1])
    (back,) = jax.linear_transpose(entries_of_row, x)(list(y))
    np.testing.assert_array_equal(back, y)
    (back,) = jax.linear_transpose(row_of, list(x))(y)
    np.testing.assert_array_equal(back, y)


def test_gradients_of_one_entry_and_of_batches():
    """d/dx of x_1^2 x_2 and its second derivatives, by hand; entries that are not used have slope zero."""

    def f(x):
        entries = entries_of_row(x)
        return jnp.sum(row_of([entries[1] ** 2 * entries[2], entries[1] * 0 + 1]))

    x = np.array([[1.0, -2.0, 4.0], [0.5, 3.0, -1.0]])
    expected = np.stack([0 * x[:, 0], 2 * x[:, 1] * x[:, 2], x[:, 1] ** 2], axis=1)
    np.testing.assert_array_equal(jax.vmap(jax.grad(f))(x), expected)
    np.testing.assert_array_equal(jax.grad(lambda x: jnp.sum(jax.vmap(f)(x)))(x), expected)
    _, a, b = x[0]
    np.testing.assert_array_equal(jax.hessian(f)(x[0]), [[0, 0, 0], [0, 2 * b, 2 * a], [0, 2 * a, 0]])
