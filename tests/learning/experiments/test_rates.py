import torch

from swimmer_mj.learning.experiments import rates as benchmark


def test_leaves_torch_as_many_threads_as_it_had(monkeypatch):
    seen = []
    monkeypatch.setattr(benchmark, "best_rates", lambda works, seconds: seen.append(torch.get_num_threads()))
    for name in ("mj_step", "viscous_mj_step", "fused", "population", "on_all_cores", "reference"):
        monkeypatch.setattr(benchmark, name, lambda *arguments: None)
    threads = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        benchmark.run_benchmark(0.0)
        assert (seen, torch.get_num_threads()) == ([1], 3)
    finally:
        torch.set_num_threads(threads)
