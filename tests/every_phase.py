"""Phase functions of every kind, some of them several times."""

import numpy as np

from tfm_cl.scene.phases import (
    DoubleHenyeyGreenstein,
    Draine,
    FournierForand,
    HenyeyGreenstein,
    Isotropic,
    KajiyaKay,
    Mie,
    PhaseMixture,
    Rayleigh,
    TabulatedPhase,
)

NODES = -np.cos(np.pi * np.linspace(0, 1, 41) ** 0.8)
"""Cosines that lie close near both ends, more so at -1."""

EVERY_PHASE = [
    Isotropic(),
    *(HenyeyGreenstein(g) for g in (-0.99, -0.4, 0.0, 0.3, 0.8, 0.99)),
    DoubleHenyeyGreenstein(),
    DoubleHenyeyGreenstein(g1=0.98, g2=-0.9, weight=0.3),
    Rayleigh(),
    Draine(),
    Draine(g=-0.9, alpha=50.0),
    *(Mie(diameter=d) for d in (5.0, 20.0, 50.0)),
    *(
        FournierForand(ior=ior, backscatter=backscatter)
        for ior, backscatter in [(1.33, 0.1), (1.02, 0.0183), (2.0, 0.5), (1.001, 1e-4)]
    ),
    TabulatedPhase(cosines=NODES, values=1 / (1.2 - NODES) + (NODES < -0.9)),
    PhaseMixture(phases=("mie:8", "rayleigh", "fournier-forand"), weights=(3, 1, 2)),
    KajiyaKay(),
]

ONE_OF_EACH_PHASE = list({type(phase): phase for phase in EVERY_PHASE}.values())
