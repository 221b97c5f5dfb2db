"""A DQN, double or not, of one agent as users of torch write it, to hold the stacked one to."""

import copy

import torch
from torch import nn


def plain_network(stack, agent):
    """The same network as torch users write it, with the agent's weights."""
    layers = []
    for weight, bias in zip(stack.weights, stack.biases, strict=True):
        linear = nn.Linear(weight.shape[1], weight.shape[2], dtype=weight.dtype)
        with torch.no_grad():
            linear.weight.copy_(weight[agent].T)
            linear.bias.copy_(bias[agent, 0])
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def distance(network, stack, agent):
    """The largest difference between a weight of the network and the agent's."""
    linears = [layer for layer in network if isinstance(layer, nn.Linear)]
    return max(
        max(
            (linear.weight.T - weight[agent]).abs().max().item(),
            (linear.bias - bias[agent, 0]).abs().max().item(),
        )
        for linear, weight, bias in zip(linears, stack.weights, stack.biases, strict=True)
    )


class PlainDDQN:
    """One agent, told its initial weights and its luck; everything else is its own."""

    def __init__(self, network, settings):
        self.online, self.target = network, copy.deepcopy(network)
        self.optimizer = torch.optim.Adam(network.parameters(), settings.learning_rate)
        self.settings = settings
        self.memory = []
        self.actions = 0
        self.updates = 0
        self.epsilon = settings.epsilon_start

    def act(self, observation, explores, which):
        if explores < self.epsilon:
            return int(which * 15)
        return int(self.online(torch.tensor(observation, dtype=torch.float64)).argmax())

    def learn(self, transition, trial_over, luck):
        s = self.settings
        if len(self.memory) < s.replay_size:
            self.memory.append(transition)
        else:
            self.memory[self.actions % s.replay_size] = transition
        self.actions += 1
        if len(self.memory) >= s.batch_size:
            self.train([self.memory[int(u * len(self.memory))] for u in luck()])
        self.epsilon = max(s.epsilon_min, self.epsilon * s.epsilon_decay)
        if trial_over:
            self.epsilon = s.epsilon_after_trial

    def train(self, batch):
        total = torch.tensor(0.0, dtype=torch.float64)
        for before, action, reward, after, ends in batch:
            goal = reward
            if not ends:
                seen = torch.tensor(after, dtype=torch.float64)
                judged = self.target(seen)
                if self.settings.double:
                    judged = judged[int(self.online(seen).argmax())]
                goal += self.settings.gamma * judged.max().item()
            error = abs(self.online(torch.tensor(before, dtype=torch.float64))[action] - goal)
            total = total + (error**2 / 2 if error < 1 else error - 0.5)
        self.optimizer.zero_grad()
        (total / len(batch)).backward()
        self.optimizer.step()
        self.updates += 1
        if self.updates % self.settings.target_period == 0:
            self.target.load_state_dict(self.online.state_dict())
