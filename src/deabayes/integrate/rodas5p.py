r"""Coefficients of Rodas5P, a Rosenbrock-Wanner method of order 5(4) with dense output.

Steinebach, "Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks
within the Julia Differential Equations package", BIT Numer. Math. 63 (2023) 27,
doi:10.1007/s10543-023-00967-x. Eight stages, L-stable, stiffly accurate; the embedded
formula of order 4 differs from the method by the last increment.

For y' = f(t, y), J = df/dy and f_t = df/dt at the start of a step h, in the form that
needs no product with J (Hairer & Wanner, Solving ODEs II, section IV.7):

    (1/(GAMMA h) - J) u_i = f(t + c_i h, y + sum_j A_ij u_j) + sum_j (C_ij/h) u_j + h D_i f_t
    y(t + h) = y + sum_j A_6j u_j (j < 6) + u_6 + u_7 + u_8,      error = u_8

The argument of stage 7 is that of stage 6 plus u_6; the argument of stage 8 is that of stage 7
plus u_7. Their nodes are 1 and their D is 0. Dense output, 0 <= x <= 1, k_r = sum_j H_rj u_j:

    y(t + x h) = (1 - x) y(t) + x [y(t + h) + (1 - x) (k_2 + x (k_3 + x k_4))]

The unit tests check the order conditions of this transcription and the measured order
of the method, of its embedded formula and of its dense output.
"""

GAMMA = 0.21193756319429014

A21 = 3.0
A31, A32 = 2.849394379747939, 0.45842242204463923
A41, A42, A43 = -6.954028509809101, 2.489845061869568, -10.358996098473584
A51, A52, A53, A54 = (
    2.8029986275628964,
    0.5072464736228206,
    -0.3988312541770524,
    -0.04721187230404641,
)
A61, A62, A63, A64, A65 = (
    -7.502846399306121,
    2.561846144803919,
    -11.627539656261098,
    -0.18268767659942256,
    0.030198172008377946,
)

C21 = -14.155112264123755
C31, C32 = -17.97296035885952, -2.859693295451294
C41, C42, C43 = 147.12150275711716, -1.41221402718213, 71.68940251302358
C51, C52, C53, C54 = (
    165.43517024871676,
    -0.4592823456491126,
    42.90938336958603,
    -5.961986721573306,
)
C61, C62, C63, C64, C65 = (
    24.854864614690072,
    -3.0009227002832186,
    47.4931110020768,
    5.5814197821558125,
    -0.6610691825249471,
)
C71, C72, C73, C74, C75, C76 = (
    30.91273214028599,
    -3.1208243349937974,
    77.79954646070892,
    34.28646028294783,
    -19.097331116725623,
    -28.087943162872662,
)
C81, C82, C83, C84, C85, C86, C87 = (
    37.80277123390563,
    -3.2571969029072276,
    112.26918849496327,
    66.9347231244047,
    -40.06618937091002,
    -54.66780262877968,
    -9.48861652309627,
)

NODE2, NODE3, NODE4, NODE5 = (
    0.6358126895828704,
    0.4095798393397535,
    0.9769306725060716,
    0.4288403609558664,
)
D1, D2, D3, D4, D5 = (
    0.21193756319429014,
    -0.42387512638858027,
    -0.3384627126235924,
    1.8046452872882734,
    2.325825639765069,
)

H21, H22, H23, H24, H25, H26, H27, H28 = (
    25.948786856663858,
    -2.5579724845846235,
    10.433815404888879,
    -2.3679251022685204,
    0.524948541321073,
    1.1241088310450404,
    0.4272876194431874,
    -0.17202221070155493,
)
H31, H32, H33, H34, H35, H36, H37, H38 = (
    -9.91568850695171,
    -0.9689944594115154,
    3.0438037242978453,
    -24.495224566215796,
    20.176138334709044,
    15.98066361424651,
    -6.789040303419874,
    -6.710236069923372,
)
H41, H42, H43, H44, H45, H46, H47, H48 = (
    11.419903575922262,
    2.8879645146136994,
    72.92137995996029,
    80.12511834622643,
    -52.072871366152654,
    -59.78993625266729,
    -0.15582684282751913,
    4.883087185713722,
)

_ROW_6 = (A61, A62, A63, A64, A65)
A = (
    (),
    (A21,),
    (A31, A32),
    (A41, A42, A43),
    (A51, A52, A53, A54),
    _ROW_6,
    (*_ROW_6, 1.0),
    (*_ROW_6, 1.0, 1.0),
    (*_ROW_6, 1.0, 1.0, 1.0),
)
"""Weights of the increments in the argument of each stage; the last row is the end of the step."""
C = (
    (),
    (C21,),
    (C31, C32),
    (C41, C42, C43),
    (C51, C52, C53, C54),
    (C61, C62, C63, C64, C65),
    (C71, C72, C73, C74, C75, C76),
    (C81, C82, C83, C84, C85, C86, C87),
)
NODES = (0.0, NODE2, NODE3, NODE4, NODE5, 1.0, 1.0, 1.0)
D = (D1, D2, D3, D4, D5, 0.0, 0.0, 0.0)
H2 = (H21, H22, H23, H24, H25, H26, H27, H28)
H3 = (H31, H32, H33, H34, H35, H36, H37, H38)
H4 = (H41, H42, H43, H44, H45, H46, H47, H48)
STAGES = len(C)
