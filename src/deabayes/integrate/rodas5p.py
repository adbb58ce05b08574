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
NODES = (
    0.0,
    0.6358126895828704,
    0.4095798393397535,
    0.9769306725060716,
    0.4288403609558664,
    1.0,
    1.0,
    1.0,
)
D = (
    0.21193756319429014,
    -0.42387512638858027,
    -0.3384627126235924,
    1.8046452872882734,
    2.325825639765069,
    0.0,
    0.0,
    0.0,
)
_ROW_6 = (
    -7.502846399306121,
    2.561846144803919,
    -11.627539656261098,
    -0.18268767659942256,
    0.030198172008377946,
)
A = (
    (),
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    _ROW_6,
    (*_ROW_6, 1.0),
    (*_ROW_6, 1.0, 1.0),
    (*_ROW_6, 1.0, 1.0, 1.0),
)
"""Weights of the increments in the argument of each stage; the last row is the end of the step."""
C = (
    (),
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (
        24.854864614690072,
        -3.0009227002832186,
        47.4931110020768,
        5.5814197821558125,
        -0.6610691825249471,
    ),
    (
        30.91273214028599,
        -3.1208243349937974,
        77.79954646070892,
        34.28646028294783,
        -19.097331116725623,
        -28.087943162872662,
    ),
    (
        37.80277123390563,
        -3.2571969029072276,
        112.26918849496327,
        66.9347231244047,
        -40.06618937091002,
        -54.66780262877968,
        -9.48861652309627,
    ),
)
H2 = (
    25.948786856663858,
    -2.5579724845846235,
    10.433815404888879,
    -2.3679251022685204,
    0.524948541321073,
    1.1241088310450404,
    0.4272876194431874,
    -0.17202221070155493,
)
H3 = (
    -9.91568850695171,
    -0.9689944594115154,
    3.0438037242978453,
    -24.495224566215796,
    20.176138334709044,
    15.98066361424651,
    -6.789040303419874,
    -6.710236069923372,
)
H4 = (
    11.419903575922262,
    2.8879645146136994,
    72.92137995996029,
    80.12511834622643,
    -52.072871366152654,
    -59.78993625266729,
    -0.15582684282751913,
    4.883087185713722,
)
STAGES = len(C)
