"""Force over the depth of a shallow contact as a power law, F = Σ_p a_p u^p: the exponents taken where nobody says.

A backend says those of its indenter (:class:`rso.contract.ForceExponents`).  Files are read before there is a backend,
so that where a record begins and what lies between its readings is found from these for every indenter; the contact is
then widened by what the other families of `POWER_LAW_FAMILIES` say of it.
"""

LEADING_EXPONENT = 1.5  # of a smooth rounded tip on a smooth body, u ≪ its radius
ROUNDED_EXPONENTS = (LEADING_EXPONENT, LEADING_EXPONENT + 1.0)  # and the first of what stiffens or softens
STIFFENING_EXPONENT = LEADING_EXPONENT + 2.0  # a third one, where it is clear
# With the priors of their families: rounded tips that stiffen more and more, flat ends, pointed ones.
POWER_LAW_FAMILIES = (
    (
        0.6,
        (
            ROUNDED_EXPONENTS,
            (*ROUNDED_EXPONENTS, STIFFENING_EXPONENT),
            (*ROUNDED_EXPONENTS, STIFFENING_EXPONENT, LEADING_EXPONENT + 3.0),
        ),
    ),
    (0.2, ((1.0, 2.0),)),
    (0.2, ((2.0, 3.0),)),
)
