"""Play episodes of Experiment 1."""


def rest(env):
    return env.rest_posture


def copy(env):
    return env.demonstrator_target


def play(env, policy=rest, n_steps=None, seed=3, **options):
    """Observations and infos of an episode, or of its first steps."""
    records, truncated = [env.reset(seed=seed, options=options)], False
    while not truncated and len(records) != n_steps:
        observation, _, _, truncated, info = env.step_to(policy(env))
        records.append((observation, info))
    return [record[0] for record in records], [record[1] for record in records]
