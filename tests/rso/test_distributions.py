"""Quantiles and tails against printed tables, and against numbers drawn from what they are of."""

import numpy as np
import pytest

from rso.core import distributions as d


@pytest.mark.parametrize(
    "found, table",
    [
        # Abramowitz & Stegun, Handbook of Mathematical Functions, tables 26.1, 26.8, 26.9 and 26.10
        (d.normal_ppf(0.95), 1.64485),
        (d.normal_cdf(1.0), 0.84134),
        (d.normal_pdf(0.0), 0.39894),
        (np.exp(d.normal_logpdf(3.0, 1.0, 2.0)), 0.24197 / 2),
        (np.exp(d.gamma_logsf(3.0, 2)), 0.19915),
        (d.gamma_ppf(0.5, 1), 0.69315),
        (d.chi2_ppf(0.95, 1), 3.84146),
        (d.chi2_ppf(0.99, 10), 23.2093),
        (d.t_ppf(0.95, 2), 2.920),
        (d.t_ppf(0.975, 10), 2.228),
        (d.f_sf(4.46, 2, 8), 0.05),
    ],
)
def test_printed_tables(found, table):
    """To the digits that are printed."""
    assert found == pytest.approx(table, rel=5e-4)


def test_tails_belong_to_squares_of_gaussian_numbers():
    """Of 2e5 sums of three squares and ratios of such: within four standard errors of a share."""
    z = np.random.default_rng(0).standard_normal((200_000, 8)) ** 2
    chi2, ratio = z[:, :3].sum(axis=1), (z[:, :3].sum(axis=1) / 3) / (z[:, 3:].sum(axis=1) / 5)
    for at in (0.5, 3.0, 8.0):
        for share, said in ((np.mean(chi2 > at), d.chi2_sf(at, 3)), (np.mean(ratio > at), d.f_sf(at, 3, 5))):
            assert abs(share - said) < 4 * np.sqrt(said * (1 - said) / len(z))
    assert d.chi2_cdf(3.0, 3) + d.chi2_sf(3.0, 3) == pytest.approx(1.0, rel=1e-14)
    assert d.chi2_cdf(-1.0, 3) == 0.0 and d.chi2_sf(-1.0, 3) == 1.0


def test_one_is_the_inverse_of_the_other():
    p = np.array([1e-6, 0.05, 0.5, 0.999])
    np.testing.assert_allclose(d.chi2_cdf(d.chi2_ppf(p, 2.5), 2.5), p, rtol=1e-10)
    np.testing.assert_allclose(d.normal_cdf(d.normal_ppf(p)), p, rtol=1e-12)
