"""The constructors of critics, offered under the package's own name."""

from controller.critic.critic import (
    from_gain as from_gain,
    from_value as from_value,
    from_weights as from_weights,
)
