"""Tests of what tools/perf decides by."""
import itertools
import os
import random
import sys
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import compare  # noqa: E402
import counts  # noqa: E402


class UTest(unittest.TestCase):
    def test_is_the_share_of_all_orders(self):
        generator = random.Random(5)
        for m, n in ((3, 4), (5, 5), (1, 6)):
            base, new = ([generator.random() for _ in range(k)] for k in (n, m))
            pool = sorted(base + new)
            u = sum(b < x for x in new for b in base)
            as_high = total = 0
            for chosen in itertools.combinations(range(m + n), m):
                other = [pool[i] for i in range(m + n) if i not in chosen]
                total += 1
                as_high += sum(b < pool[i] for i in chosen for b in other) >= u
            self.assertAlmostEqual(compare.u_test(base, new), as_high / total, places=12)

    def test_of_equal_samples_says_nothing(self):
        self.assertGreaterEqual(compare.u_test([1.0] * 9, [1.0] * 9), 0.5)

    def test_of_samples_apart_is_one_order_of_all(self):
        self.assertAlmostEqual(compare.u_test(range(9), range(10, 19)), 1 / 48620)


class Slower(unittest.TestCase):
    base = [100 + i for i in range(9)]

    def test_needs_five_per_cent(self):
        self.assertFalse(compare.slower([100 + 0.01 * i for i in range(9)], [104 + 0.01 * i for i in range(9)]))
        self.assertTrue(compare.slower([100 + 0.01 * i for i in range(9)], [106 + 0.01 * i for i in range(9)]))

    def test_needs_more_than_one_disturbed_sample(self):
        self.assertFalse(compare.slower(self.base, self.base[:-3] + [500, 600, 700]))

    def test_is_not_quicker(self):
        self.assertFalse(compare.slower(self.base, [0.5 * t for t in self.base]))


class Counts(unittest.TestCase):
    def one(self, **instructions):
        return {"scene": {"instructions": instructions, "work": {"contacts": 0}}}

    def test_a_rise_beyond_three_per_cent_is_told(self):
        compared, risen, fallen = counts.compare(self.one(step=1000, tear=1000), self.one(step=1031, tear=1029))
        self.assertEqual((compared, [row[0] for row in risen], fallen), (3, ["scene: step"], []))

    def test_a_fall_is_no_rise(self):
        _, risen, fallen = counts.compare(self.one(step=1000), self.one(step=900))
        self.assertEqual((risen, [row[0] for row in fallen]), ([], ["scene: step"]))

    def test_what_is_no_longer_counted_fails(self):
        self.assertEqual(len(counts.compare(self.one(step=1000), self.one())[1]), 1)
        self.assertEqual(len(counts.compare(self.one(), self.one(step=1000))[1]), 1)

    def test_something_from_nothing_is_a_rise(self):
        new = self.one(step=1000)
        new["scene"]["work"]["contacts"] = 3
        self.assertEqual([row[0] for row in counts.compare(self.one(step=1000), new)[1]], ["scene: contacts"])

    def test_names_are_read_off_the_profile(self):
        for line, name in (
                (" 1,175 (45.2%)  ???:sulcus::step(sulcus::Scene const&) [x]", "step"),
                ("   342 ( 2.1%)  ???:sulcus::SolveResult sulcus::conjugate_gradients<float>(sulcus::RowMatrix<float>"
                 " const&) [x]", "conjugate_gradients"),
                (" 9 ( 0.1%)  ???:void sulcus::isa_avx2::(anonymous namespace)::multiply<float>(float*) [x]",
                 "multiply")):
            self.assertEqual(counts.NAME.match(line).group(2), name)


if __name__ == "__main__":
    unittest.main()
