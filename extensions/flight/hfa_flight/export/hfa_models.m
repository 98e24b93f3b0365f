function [models, data, array] = hfa_models(file)
% HFA_MODELS  Linear models in a .mat file of `hfa sweep` or `hfa linearize` as state-space systems.
%
%   [models, data] = hfa_models(file)
%   [models, data, array] = hfa_models(file)   MATLAB only
%
%   models: cell array, one ss a point of the sweep, in its order, with the names of states, inputs and outputs;
%   [] where there is no trim.
%   data: everything in the file: data.A (n, n, N), data.B (n, m, N), the varied values and their names, operating
%   points (the offsets X0, U0 of the models). Of hfa linearize --conditions, data.models(k) is the k-th condition, with
%   its trim by name, data.models(k).trim.alpha, complex eigenvalues, and a cell of names, data.models(k).condition.free. data.units: 'english' (ft, slug, lbf, rad), 'si' (m, kg, N, rad) or 'mixed'.
%   array: the models that there are as one ss array, array(:, :, k). Octave's package control has no such arrays.
%
%   Needs the Control System Toolbox, or in Octave: pkg load control.
data = load(file);
if isfield(data, 'models')
    [models, data] = of_conditions(data);
    array = [];
    return
end
if ~isfield(data, 'A') || ~isfield(data, 'B') || ~isfield(data, 'states') || ~isfield(data, 'inputs')
    error('hfa_models: %s has no A, B, states and inputs; give a .mat file of hfa sweep or hfa linearize', file);
end
count = size(data.A, 3);
models = cell(1, count);
for k = 1:count
    A = data.A(:, :, k);
    B = data.B(:, :, k);
    if any(isnan(A(:)))
        continue
    end
    if isfield(data, 'C') && count == 1
        C = data.C; D = data.D; outputs = data.outputs;
    else
        C = eye(size(A, 1)); D = zeros(size(B)); outputs = data.states;
    end
    models{k} = ss(A, B, C, D, 'statename', data.states(:), 'inputname', data.inputs(:), ...
                   'outputname', outputs(:));
end
if nargout > 2
    if exist('OCTAVE_VERSION', 'builtin')
        error('hfa_models: Octave has no arrays of systems; use models, a cell array');
    end
    found = models(~cellfun(@isempty, models));
    array = stack(1, found{:});
end
end

function [models, data] = of_conditions(data)
% Systems of the conditions of a file, with inputs and then disturbances as inputs; [] without a trim.
count = numel(data.models);
models = cell(1, count);
names = [data.trim_state_names(:); data.trim_input_names(:)];
for k = 1:count
    each = data.models(k);
    roots = each.eigenvalues;
    each.eigenvalues = complex(roots(:, 1), roots(:, 2));
    free = each.condition.free;
    if isempty(free)
        free = {};
    elseif ~iscell(free)
        free = cellstr(free);
    end
    each.condition.free = free;
    each.trim = cell2struct(num2cell([each.trim_states(:); each.trim_inputs(:)]), names, 1);
    all_models(k) = each; %#ok<AGROW>
    if any(isnan(each.A(:)))
        continue
    end
    models{k} = ss(each.A, [each.B, each.E], each.C, [each.D, each.F], 'statename', data.states(:), ...
                   'inputname', [data.inputs(:); data.disturbances(:)], 'outputname', data.outputs(:));
end
data.models = all_models;
end
