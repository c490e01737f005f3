"""Force over the depth of a shallow contact as a power law, F = Σ_p a_p u^p: the exponents taken where nobody says.

A backend says those of its indenter (:class:`rso.contract.ForceExponents`).  Files are read before there is a backend,
so that where a record begins and what lies between its readings is found from these for every indenter; the contact is
then widened by what the other families of `FAMILIES` say of it.
"""

LEADING = 1.5  # of a smooth rounded tip on a smooth body, u ≪ its radius
ROUNDED = (LEADING, LEADING + 1.0)  # and the first of what stiffens or softens
STIFFENS = LEADING + 2.0  # a third one, where it is clear
# With the priors of their families: rounded tips that stiffen more and more, flat ends, pointed ones.
FAMILIES = (
    (0.6, (ROUNDED, (*ROUNDED, STIFFENS), (*ROUNDED, STIFFENS, LEADING + 3.0))),
    (0.2, ((1.0, 2.0),)),
    (0.2, ((2.0, 3.0),)),
)
