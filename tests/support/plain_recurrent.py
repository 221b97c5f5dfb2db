"""A recurrent double DQN of one agent, written step by step, to compare the stacked one with."""

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

CELL_PARAMETERS = {
    "weight_ih": "input_weight",
    "weight_hh": "hidden_weight",
    "bias_ih": "input_bias",
    "bias_hh": "hidden_bias",
}


class PlainNetwork(nn.Module):
    """The same network as torch users write it, with the agent's weights."""

    def __init__(self, stack, agent):
        super().__init__()
        _, inputs, _ = stack.cell.input_weight.shape
        hidden = stack.cell.hidden
        self.cell = nn.GRUCell(inputs, hidden).double()
        layers = []
        with torch.no_grad():
            for theirs, ours in CELL_PARAMETERS.items():
                weight = getattr(stack.cell, ours)[agent].T.squeeze(1)
                getattr(self.cell, theirs).copy_(weight)
            for layer in (stack.reads, stack.values):
                linear = nn.Linear(*layer.weight.shape[1:]).double()
                linear.weight.copy_(layer.weight[agent].T)
                linear.bias.copy_(layer.bias[agent, 0])
                layers += [linear, nn.ReLU()]
        self.head = nn.Sequential(*layers[:-1])

    def forward(self, inputs, state):
        """Values of the actions, and the state after it; no state is the one to begin with."""
        state = self.cell(torch.tensor(inputs, dtype=torch.float64), state)
        return self.head(state), state

    def distance(self, stack, agent):
        """The largest difference between a weight of this network and the agent's."""
        other = PlainNetwork(stack, agent)
        pairs = zip(self.parameters(), other.parameters(), strict=True)
        return max((mine - theirs).abs().max().item() for mine, theirs in pairs)


@dataclass
class Moment:
    """One step as it is remembered."""

    inputs: Any
    state: Any
    action: int
    reward: float
    not_done: bool
    segment: int


class PlainRecurrent:
    """One agent, told its initial weights and its luck; everything else is its own."""

    def __init__(self, network, settings):
        self.online, self.target = network, copy.deepcopy(network)
        self.optimizer = torch.optim.Adam(network.parameters(), settings.learning_rate)
        self.settings = settings
        self.moments, self.state, self.did = [], None, [0.0] * 17
        self.segment = 0
        self.updates = 0
        self.epsilon = settings.epsilon_start

    def act(self, view, agent, explores, which):
        shown = view.console
        numbers = [
            *view.observation[agent],
            *self.did,
            shown.solutions_found[agent] / 3,
            shown.solutions_left[agent] / 3,
            shown.attempts_left[agent] / 12,
            shown.actions_left[agent] / 3,
        ]
        self.inputs = np.array(numbers, dtype=np.float32)
        with torch.no_grad():
            values, self.after = self.online(self.inputs, self.state)
        return int(which * 15) if explores < self.epsilon else int(values.argmax())

    def learn(self, step, agent, luck):
        s = self.settings
        action, reward = int(step.action[agent]), float(step.reward[agent])
        trial_over = bool(step.trial_over[agent])
        ends = trial_over if s.bootstrap_over_attempts else bool(step.attempt_over[agent])
        self.moments.append(Moment(self.inputs, self.state, action, reward, not ends, self.segment))
        self.state = self.after
        did = [0.0] * 17
        did[action] = 1.0
        did[15] = np.copysign(np.log(1 + abs(reward)), reward)
        did[16] = float(any(step.outcome[agent] != step.view.observation[agent]))
        self.did = did
        if trial_over and s.reset == "trial":
            self.state, self.did = None, [0.0] * 17
            self.segment += 1
        count = len(self.moments)
        if count > s.unroll and count % s.train_period == 0:
            self.train(luck())
        self.epsilon = max(s.epsilon_min, self.epsilon * s.epsilon_decay)
        if trial_over:
            self.epsilon = s.epsilon_after_trial

    def train(self, luck):
        s = self.settings
        kept = self.moments[-s.replay_size :]
        errors = []
        for which, where in zip(luck[: s.batch_size], luck[s.batch_size :], strict=True):
            drawn = int(which * (len(kept) - 1))
            start = drawn - int(where * s.unroll)
            while start < 0 or kept[start].segment != kept[drawn].segment:
                start += 1
            begin = start
            while begin > max(start - s.burn_in, 0) and (
                kept[begin - 1].segment == kept[start].segment
            ):
                begin -= 1
            errors += self.td_errors(kept, begin, start)
        loss = sum(errors, torch.tensor(0.0)) / len(errors)
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.updates += 1
        if self.updates % s.target_period == 0:
            self.target.load_state_dict(self.online.state_dict())

    def td_errors(self, kept, begin, start):
        online = target = kept[begin].state
        with torch.no_grad():
            for moment in kept[begin:start]:
                _, online = self.online(moment.inputs, online)
                _, target = self.target(moment.inputs, target)
        errors = []
        for at in range(start, min(start + self.settings.unroll, len(kept) - 1)):
            moment = kept[at]
            if moment.segment != kept[start].segment:
                break
            values, online = self.online(moment.inputs, online)
            with torch.no_grad():
                _, target = self.target(moment.inputs, target)
                goal = moment.reward
                if moment.not_done:
                    chooses, _ = self.online(kept[at + 1].inputs, online)
                    judges, _ = self.target(kept[at + 1].inputs, target)
                    goal += self.settings.gamma * judges[int(chooses.argmax())].item()
            error = abs(values[moment.action] - goal)
            errors.append(error**2 / 2 if error < 1 else error - 0.5)
        return errors
