/* C from CppADCodeGen for LADDER(L) and PINNED(n): records Pinocchio's constraintDynamics; see loops_against_pinocchio.py.
 *
 *     pinocchio_codegen ladder|pinned SIZE WHAT
 *
 * prints `void f(const double *x, double *y)`, x = length, q, u; y = udot (WHAT = 0), or udot and d udot/d length (WHAT = 1),
 * straight-line code without a joint force.
 */
#include <cppad/cg.hpp>
#include <cppad/cg/support/cppadcg_eigen.hpp>
#include <pinocchio/codegen/cppadcg.hpp>

#include "pinocchio_mechanisms.hpp"

#include <pinocchio/algorithm/constrained-dynamics.hpp>

#include <cstdlib>
#include <iostream>

typedef CppAD::cg::CG<double> Code;
typedef CppAD::AD<Code> Recorded;
typedef Eigen::Matrix<Recorded, Eigen::Dynamic, 1> Vector;

int main(int argc, char **argv)
{
    if (argc != 4) return 2;
    const bool ladder = std::string(argv[1]) == "ladder", derivative = std::string(argv[3]) == "1";
    const int size = std::atoi(argv[2]), n = ladder ? 2 * size + 1 : size, inputs = 1 + 2 * n;

    Vector x(inputs);
    for (int i = 0; i < inputs; ++i) x[i] = Recorded(i ? 0.2 + 0.01 * i : 1.0);
    CppAD::Independent(x);
    Mechanism<Recorded> m(ladder, size, x[0]);
    Mechanism<Recorded>::Data data(m.model);
    pinocchio::initConstraintDynamics(m.model, data, m.loops, m.loop_data);
    /* A flat loop has one condition too many: regularised, with one iteration to take the bias out again. */
    pinocchio::ProximalSettingsTpl<Recorded> settings(Recorded(1e-12), Recorded(ladder ? 1e-10 : 0.0), ladder ? 2 : 1);
    const Vector q = x.segment(1, n), u = x.segment(1 + n, n), force = Vector::Constant(n, Recorded(0.0));
    const Vector y = pinocchio::constraintDynamics(m.model, data, q, u, force, m.loops, m.loop_data, settings);
    CppAD::ADFun<Code> recorded(x, y);
    recorded.optimize("no_compare_op");

    CppAD::cg::CodeHandler<double> handler;
    CppAD::vector<Code> at(inputs), along(inputs);
    handler.makeVariables(at);
    const CppAD::vector<Code> values = recorded.Forward(0, at);
    CppAD::vector<Code> results(derivative ? 2 * n : n);
    for (int i = 0; i < n; ++i) results[i] = values[i];
    if (derivative) {
        for (int i = 0; i < inputs; ++i) along[i] = Code(i == 0 ? 1.0 : 0.0);
        const CppAD::vector<Code> tangent = recorded.Forward(1, along);
        for (int i = 0; i < n; ++i) results[n + i] = tangent[i];
    }
    CppAD::cg::LanguageC<double> language("double");
    CppAD::cg::LangCDefaultVariableNameGenerator<double> names;
    std::ostringstream body;
    handler.generateCode(body, language, results, names);
    std::cout << "#include <math.h>\nvoid f(const double *x, double *y)\n{\n"
              << language.generateTemporaryVariableDeclaration() << body.str() << "}\n";
}
