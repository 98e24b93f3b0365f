function [models, data, array] = hfa_models(file)
% HFA_MODELS  Linear models in a .mat file of `hfa sweep` or `hfa linearize` as state-space systems.
%
%   [models, data] = hfa_models(file)
%   [models, data, array] = hfa_models(file)   MATLAB only
%
%   models: cell array, one ss a point of the sweep, in its order, with the names of states, inputs and outputs;
%   [] where there is no trim.
%   data: everything in the file: data.A (n, n, N), data.B (n, m, N), the varied values and their names, operating
%   points (the offsets X0, U0 of the models). data.units: 'english' (ft, slug, lbf, rad) or 'si' (m, kg, N, rad).
%   array: the models that there are as one ss array, array(:, :, k). Octave's package control has no such arrays.
%
%   Needs the Control System Toolbox, or in Octave: pkg load control.
data = load(file);
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
